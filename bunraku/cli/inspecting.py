"""bunraku inspect: what a file holds, and what is wrong with it."""

from pathlib import Path

import msgspec
import typer

from bunraku.cli.failures import about, printing_warnings
from bunraku.formats import inspect


def print_inspection(path: Path, *, as_json: bool) -> None:
    """Print what the inspection of a file found, one fact a line, or as JSON."""
    with about(path), printing_warnings(path):
        found = msgspec.json.encode(inspect(path))
    if as_json:
        typer.echo(msgspec.json.format(found, indent=2))
        return
    for name, value in msgspec.json.decode(found).items():
        typer.echo(f"{name}: {plainly(value)}")


def plainly(value: object) -> str:
    """Put a value of JSON on one line, as a person would write it."""
    match value:
        case bool():
            return "yes" if value else "no"
        case dict() if value:
            return ", ".join(f"{name} {plainly(part)}" for name, part in value.items())
        case list() if value:
            return "; ".join(plainly(part) for part in value)
        case float():
            return f"{value:.4g}"
    return str(value) if value or value == 0 else "none"
