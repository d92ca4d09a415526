"""Write docs/errors.md anew: every code of a fault and what it means, from bunraku/errors.py.

python scripts/list_errors.py
"""

from itertools import groupby
from pathlib import Path

from bunraku.errors import Code
from bunraku.limits import SUMMARY

PAGE = Path(__file__).parents[1] / "docs" / "errors.md"
HEAD = f"""# Codes of faults

Whatever is wrong with a file ends in a line `error: FILE: what, where, how to fix [CODE]` on
stderr and exit code 2 (3 for `MATCH_POOR`); or, if it was repaired or does little harm, in
`warning: FILE: ... [CODE]`. `bunraku inspect FILE --json` lists the same codes under `faults`, with
their place and severity: a *warning* was repaired or may spoil a result, a *note* is common and
harmless. Codes are stable; wording is not. From Python, `FormatError` carries `code`, `path`,
`where` and `message`.

{SUMMARY}

This page is written by `python scripts/list_errors.py`.
"""


def write_page() -> str:
    """Give the page: one table for each family of codes, by the first word of their names."""
    parts = [HEAD]
    for family, codes in groupby(Code, key=lambda code: code.name.partition("_")[0]):
        rows = [f"| `{code.name}` | {code.value} |" for code in codes]
        parts.append("\n".join([f"| {family} | |", "|---|---|", *rows]) + "\n")
    return "\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(write_page())
