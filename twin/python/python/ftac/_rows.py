"""Rows of trials that show themselves."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import Any

COLUMNS = ("policy", "combination", "trial", "first", "second", "clean_success", "contact", "success", "cause", "retries", "sim_seconds")
"""Columns that a notebook shows; `pandas.DataFrame` has all."""
SHOWN = 60
"""Rows that a notebook shows at most."""
OUTCOMES = ("contact", "success", "clean_success")


def rates(rows: Iterable[dict[str, Any]]) -> dict[str, dict[str, float]]:
    """See `ftac.bench.rates`."""
    by_policy: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        by_policy.setdefault(row["policy"], []).append(row)
    return {
        policy: {"trials": len(own), **{name: sum(row[name] for row in own) / len(own) for name in OUTCOMES}}
        for policy, own in by_policy.items()
    }


class Rows(list[dict[str, Any]]):
    """A list with a row for each trial, as `ftac.bench.run` returns it. A notebook shows it as a table."""

    def __repr__(self) -> str:
        found = [f"{policy}: {own['trials']:.0f} x clean success {own['clean_success']:.2f}" for policy, own in rates(self).items()]
        return f"<{len(self)} trials; {', '.join(found)}>" if self else "<no trials>"

    def _repr_html_(self) -> str:
        def cells(kind: str, texts: Iterable[str]) -> str:
            return "<tr>" + "".join(f"<{kind}>{escape(text)}</{kind}>" for text in texts) + "</tr>"

        body = "".join(cells("td", (shown(row.get(name)) for name in COLUMNS)) for row in self[:SHOWN])
        more = f"<p>{len(self) - SHOWN} more rows</p>" if len(self) > SHOWN else ""
        return f"<p>{escape(repr(self)[1:-1])}</p><table>{cells('th', COLUMNS)}{body}</table>{more}"


def shown(value: Any) -> str:
    """A value of a row in words: yes or no, a number, a text; nothing for None."""
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.3g}" if isinstance(value, float) else str(value)
