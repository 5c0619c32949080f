# SPDX-License-Identifier: Apache-2.0
"""Compiled kernels: arrays in, arrays out; no files, no checks, nothing raised.

Every check lies in the functions that call them. Each kernel has a slow, obvious counterpart in
`tests/naive/`, against which it is compared.
"""
