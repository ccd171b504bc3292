"""Times that are written as text: dates with or without a zone, and times of day."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_DAY_FIRST = r"(\d{1,2})\.(\d{1,2})\.(\d{4})[ T]+"
_ISO = r"\3-\2-\1T"
_TIME_OF_DAY = r"\d{1,3}:\d{2}:\d{2}(?:\.\d+)?"


class NotATime(Exception):
    """A text is not a time; says in which row, from 0."""

    def __init__(self, row: int) -> None:
        super().__init__(row)
        self.row = row


def parse_times(cells: NDArray[Any]) -> NDArray[Any]:
    """Return texts as datetime64[ns] in UTC or timedelta64[ns], shape (n,), NaT where empty.

    Read are ISO 8601 (`2025-03-01T12:00:00.5+01:00`, also with a blank, a comma or `UTC`), days
    before months where points stand between them (`01.03.2025 12:00:00`), and times of day
    (`12:00:00.5`). `03/01/2025` is not: either number may be the month.

    Raises:
        NotATime: one is anything else.
    """
    import pandas as pd

    given = pd.Series(cells)
    there = given.notna()
    texts = given.astype(str).str.strip().str.replace(",", ".", regex=False)
    texts = texts.str.replace(r"\s*UTC$", "Z", regex=True).where(there)
    of_day = texts[there].str.fullmatch(_TIME_OF_DAY)
    if of_day.sum() > 0.5 * of_day.size:
        found = pd.to_timedelta(texts, errors="coerce").to_numpy().astype("timedelta64[ns]")
    else:
        texts = texts.str.replace(_DAY_FIRST, _ISO, regex=True)
        dates = pd.to_datetime(texts, format="ISO8601", utc=True, errors="coerce")
        found = dates.dt.tz_localize(None).to_numpy().astype("datetime64[ns]")
    wrong = np.flatnonzero(np.isnat(found) & there.to_numpy())
    if wrong.size:
        raise NotATime(int(wrong[0]))
    return found
