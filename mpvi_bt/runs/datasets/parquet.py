"""Files of a dataset. The only module that knows pandas."""

from __future__ import annotations

import importlib.util
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from mpvi_bt.ground.errors import UserError
from mpvi_bt.ground.extras import install
from mpvi_bt.ground.writing import write_whole

Table = Mapping[str, NDArray[Any]]


def require_pandas() -> None:
    """Raise UserError unless what writes tables is installed."""
    if importlib.util.find_spec("pandas") is None or importlib.util.find_spec("pyarrow") is None:
        raise UserError(f"datasets need pandas and pyarrow, which are not installed: {install('dataset')}")


def write_table(table: Table, file: Path) -> None:
    """Columns (n,) or (n, size) as Parquet, the latter as lists of the column's own type."""
    import pandas as pd

    write_frame(pd.DataFrame({key: list(column) if column.ndim > 1 else column for key, column in table.items()}), file)


def write_rows(rows: Sequence[Mapping[str, Any]], file: Path) -> None:
    """Rows with the same keys as Parquet."""
    import pandas as pd

    write_frame(pd.DataFrame(rows), file)


def write_index(names: Sequence[str], column: str, file: Path) -> None:
    """The number of each name, as a Parquet table that is looked up by the name."""
    import pandas as pd

    write_frame(pd.DataFrame({column: range(len(names))}, index=list(names)), file)


def write_frame(frame: Any, file: Path) -> None:
    """A pandas frame as Parquet."""
    file.parent.mkdir(parents=True, exist_ok=True)
    frame.to_parquet(file)


def write_json(content: Any, file: Path) -> None:
    """Strict JSON, to be read by people, too."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, json.dumps(content, indent=4, ensure_ascii=False, allow_nan=False))


def write_lines(lines: Iterable[Any], file: Path) -> None:
    """JSON Lines."""
    file.parent.mkdir(parents=True, exist_ok=True)
    write_whole(file, "".join(f"{json.dumps(line, ensure_ascii=False, allow_nan=False)}\n" for line in lines))
