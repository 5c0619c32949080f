# SPDX-License-Identifier: Apache-2.0
"""Maps in the browser: what a page is given, the page, its server, and the widget."""
