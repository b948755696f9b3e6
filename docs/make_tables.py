"""Run what the pages print and write it: ``python docs/make_tables.py [NAME ...]``.

Each table, or text of the command, is kept as ``docs/_static/tables/<name>.json`` and stands on its page between two
comments that name it. Runs those named, else those that are stale, because a problem or the code that decides them has
changed since. ``--write`` runs nothing and writes the pages from what is kept; ``--check`` runs nothing, and fails
where a table is stale. Times are kept by the benchmarks that measure them (``make times``); only their pages are
written here.
"""

from __future__ import annotations

import sys
from pathlib import Path

import printed
from printed import distributions, front, objectives, paper, plans, systems, terminal, times

TABLES = printed.ROOT / "docs" / "_static" / "tables"
TABLES_OF = {
    **plans.TABLES,
    **objectives.TABLES,
    **distributions.TABLES,
    **systems.TABLES,
    **terminal.TABLES,
    **front.TABLES,
}
"""Name of each table and what makes it."""


def stale(name: str) -> bool:
    """Whether a table is of other code or other problems."""
    return bool(printed.read(_file(name)).get("source") != TABLES_OF[name].source())


def _file(name: str) -> Path:
    """Where a table is kept."""
    return TABLES / f"{name}.json"


def run(name: str) -> None:
    """Make a table again and keep it."""
    source = TABLES_OF[name].source()
    rows = TABLES_OF[name].run(TABLES_OF[name].problems)
    printed.write(_file(name), {"source": source, "rows": rows})
    print(name, *TABLES_OF[name].lines(rows), sep="\n", flush=True)


def blocks() -> dict[str, tuple[str, list[str]]]:
    """The page of each block, and the lines that its file says."""
    found = {}
    for name, table in TABLES_OF.items():
        found[name] = table.page, list(table.lines(printed.read(_file(name))["rows"]))
    for name, timed in {**times.TABLES, **paper.TABLES}.items():
        kept = printed.read(timed.path)
        found[name] = (timed.page, list(timed.lines(kept["rows"], kept["machine"])))
    return found


def main(arguments: list[str]) -> None:
    """Run what is asked for, else what is stale, and write the pages.

    Raises
    ------
    SystemExit
        With ``--check``, if a table is stale.
    """
    if "--write" not in arguments:
        names = [name for name in TABLES_OF if stale(name)]
        if "--check" in arguments:
            raise SystemExit(f"stale: {', '.join(names)}; run python docs/make_tables.py" if names else 0)
        for name in arguments or names:
            run(name)
    for name, (page, lines) in blocks().items():
        path = printed.ROOT / page
        text, _ = printed.block(path.read_text(encoding="utf-8"), name, lines)
        path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
