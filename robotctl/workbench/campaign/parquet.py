"""The results of a campaign as a table in Parquet, for pandas and the like; the extra `campaign`.

Lines of JSON remain the record: they can be appended, and survive a kill.
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from robotctl.errors import ConfigError
from robotctl.runtime.storage.atomic_file import write_whole
from robotctl.workbench.campaign.conditions import Condition, report_fields, value_of
from robotctl.workbench.campaign.results import Head, Result

TABLE: Final = "runs.parquet"
"""Name of the file in the folder of the results."""


def write_parquet(folder: Path, head: Head, results: Sequence[Result]) -> None:
    """Write the results into a folder; the same results give the same bytes.

    Raises
    ------
    ConfigError
        If the extra is not installed.
    OSError
        If the disk refuses.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415 - an extra
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError as error:
        raise ConfigError(
            f"{TABLE} was not written: pyarrow is not installed; the extra `campaign` has it"
        ) from error
    types = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}
    arrays = {
        name: pa.array(values, type=types[kind])
        for name, (kind, values) in columns(head, results).items()
    }
    content = io.BytesIO()
    parquet.write_table(pa.table(arrays), content, compression="zstd")
    write_whole(folder / TABLE, content.getvalue())


def columns(head: Head, results: Sequence[Result]) -> dict[str, tuple[type, list[Any]]]:
    """Return the columns of the table: type and values of each, None where there is none.

    They are the number of the run, its factors, `passed`, `reason`, each criterion by its text,
    and the fields of the report, `report.time_s`.
    """
    verdicts = [head.judge(each) for each in results]
    found: dict[str, tuple[type, list[Any]]] = {"number": (int, [each.number for each in results])}
    for name in dict.fromkeys(name for each in results for name in each.factors):
        found[name] = _column([each.factors.get(name) for each in results])
    found["passed"] = bool, [each.passed for each in verdicts]
    found["reason"] = str, ["; ".join(each.why) for each in verdicts]
    own = [{str(each): each for each in head.conditions_of(result)} for result in results]
    for criterion in map(str, head.conditions):
        pairs = zip(results, own, strict=True)
        found[criterion] = bool, [_fulfils(each, asked.get(criterion)) for each, asked in pairs]
    for name, kind in report_fields().items():
        values = [value_of(each.report or {}, name) for each in results]
        found[f"report.{name}"] = kind, [_cast(kind, each) for each in values]
    return found


def _fulfils(result: Result, condition: Condition | None) -> bool | None:
    """Return whether a run fulfils a condition; None if it has no result, or no such condition."""
    if result.report is None or condition is None:
        return None
    return not condition.violation(result.report)


def _column(values: Sequence[Any]) -> tuple[type, list[Any]]:
    """Return the narrowest type that all values of a factor have, and them in it."""
    kinds = {type(each) for each in values if each is not None}
    kind = next(iter(kinds)) if len(kinds) == 1 else float if kinds == {int, float} else str
    if kind not in (bool, int, float, str):
        kind = str
    return kind, [_cast(kind, each) for each in values]


def _cast(kind: type, value: Any) -> Any:
    """Return a value in the type of its column; what is no text there is written as JSON."""
    if value is None or isinstance(value, kind):
        return value
    if kind is str:
        return json.dumps(value, ensure_ascii=False)
    return kind(value)
