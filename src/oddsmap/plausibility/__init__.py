# SPDX-License-Identifier: Apache-2.0
"""Whether a log can be what it says: doubts of its units and of the form of its poses."""
