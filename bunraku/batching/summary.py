"""Sum up a batch: a table for programs, and a page for people, the worst figures first."""

import csv
import html
import io
from collections.abc import Sequence
from pathlib import Path

from bunraku.batching.records import Record
from bunraku.formats.files import write_atomically

MEASURES = ("stretch_p99", "foot_slide_m", "penetration_fraction")  # the worst among the clips
COLUMNS = ("figure", "performance", "state", "confidence", "seconds", *MEASURES, "output", "note")


def sort_worst_first(records: Sequence[Record]) -> list[Record]:
    """Order records: those without a result, then those with the least confidence."""
    return sorted(records, key=lambda record: (record.state == "done", record.confidence))


def write_table(path: Path, records: Sequence[Record]) -> None:
    """Write a line for each job, in the order of the jobs."""
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(COLUMNS)
    lines.writerows(_cells(record) for record in records)
    write_atomically(path, text.getvalue().encode())


def _cells(record: Record) -> list[str]:
    is_done = record.state == "done"
    worst = [record.worst(measure) for measure in MEASURES]
    return [
        record.job.figure,
        record.job.performance or "",
        record.state,
        f"{record.confidence:.3f}" if is_done else "",
        f"{record.seconds:.2f}",
        *("" if value is None else f"{value:.4g}" for value in worst),
        f"results/{record.name}.glb" if is_done else "",
        record.error or "; ".join(record.warnings),
    ]


def write_page(path: Path, records: Sequence[Record]) -> None:
    """Write a page with a picture of every figure beside what is known of it."""
    done = sum(record.state == "done" for record in records)
    cards = "\n".join(_card(record) for record in sort_worst_first(records))
    title = f"{done} of {len(records)} figures move"
    page = PAGE.replace("{title}", title).replace("{cards}", cards)
    write_atomically(path, page.encode())


def _card(record: Record) -> str:
    """Show one job."""
    name = html.escape(Path(record.job.figure).name)
    where = html.escape(f"{record.job.figure} with {record.job.performance or 'built-in human'}")
    if record.state != "done":
        return (
            f'<article class="failed"><div class="none">{record.state}</div>'
            f'<h2 title="{where}">{name}</h2><p>{html.escape(record.error)}</p></article>'
        )
    file, share = f"results/{record.name}", record.confidence
    notes = "".join(f"<p>{html.escape(warning)}</p>" for warning in record.warnings)
    numbers = [(m, record.worst(m)) for m in MEASURES]
    facts = "".join(f"<dt>{m}</dt><dd>{v:.3g}</dd>" for m, v in numbers if v is not None)
    return (
        f'<article><a href="{file}.glb"><img loading="lazy" src="{file}.png" alt="{name}"></a>'
        f'<h2 title="{where}">{name}</h2>'
        f"<p>confidence {share:.2f} <meter low=.3 high=.5 optimum=1 value={share:.3f}></meter></p>"
        f"<dl>{facts}<dt>seconds</dt><dd>{record.seconds:.1f}</dd></dl>{notes}</article>"
    )


PAGE = """<!doctype html>
<html lang="en"><meta charset="utf-8"><title>{title}</title>
<meta name="viewport" content="width=device-width">
<style>
:root { color-scheme: light dark; font: 15px/1.45 system-ui, sans-serif }
body { margin: 2rem auto; max-width: 90rem; padding: 0 1rem }
main { display: grid; gap: 1rem; grid-template-columns: repeat(auto-fill, minmax(18rem, 1fr)) }
article { border: 1px solid #8886; border-radius: .6rem; overflow: hidden; padding-bottom: .6rem }
article > :not(a, .none) { margin: .4rem .9rem }
img { width: 100%; display: block; aspect-ratio: 420 / 184; object-fit: contain }
img, .none { background: #f6f4f0 }
.none { padding: 3.2rem 0; text-align: center; color: #a33; font-weight: 600 }
h2 { font-size: 1rem; overflow-wrap: anywhere }
dl { display: grid; grid-template-columns: auto 1fr; gap: 0 1rem; font-size: .87rem }
dd { margin: 0; text-align: right; font-variant-numeric: tabular-nums }
p { overflow-wrap: anywhere }
</style>
<h1>{title}</h1>
<p>Worst first. A picture leads to its file.</p>
<main>
{cards}
</main>
</html>
"""
