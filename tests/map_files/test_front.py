# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from io import BytesIO

import pytest

from oddsmap.map_files import front


@pytest.mark.parametrize("size", [0, 1, 9, 10, 11, 95])
@pytest.mark.parametrize("header", [b"", b"x", b"0123456789", b"longer than a block"])
def test_all_moves_on(size: int, header: bytes, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(front, "_BLOCK", 10)
    body = bytes(range(size))
    file = BytesIO(body)
    front.put_in_front(file, header)
    assert file.getvalue() == header + body
