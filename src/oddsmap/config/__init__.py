# SPDX-License-Identifier: Apache-2.0
"""Every field that changes a result."""
