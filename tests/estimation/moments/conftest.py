"""What several of these tests share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from coheft.estimation.moments import row_buffer


@pytest.fixture(scope="module")
def few_rows_are_kept() -> Iterator[None]:
    """Buffers keep 6 to 12 rows, and may see moments from a state once they have 4."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(row_buffer, "LEAST_KEPT", 6)
        patch.setattr(row_buffer, "_LEAST_TO_PROJECT", 4)
        yield
