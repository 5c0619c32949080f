# SPDX-License-Identifier: Apache-2.0
"""Maps in the browser: what a page is given, the page, and the server on this machine."""
