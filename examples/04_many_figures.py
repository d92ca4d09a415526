"""Animate several figures, a process each, and look at the worst first.

python examples/04_many_figures.py
"""

import tempfile
from pathlib import Path

import bunraku
from bunraku import builtin


def main() -> list[str]:
    """Animate the built-in figures and one that is missing; give how each job ended."""
    jobs = [
        bunraku.Job(figure=str(path), clips=("walk",)) for path in builtin.figure_paths().values()
    ]
    with tempfile.TemporaryDirectory() as folder:
        records = bunraku.batch([*jobs, bunraku.Job(figure="missing.obj")], folder, workers=2)
        again = bunraku.batch(jobs, folder, workers=2, resume=True)  # nothing is done twice
        print(f"{sum(path.stat().st_size for path in Path(folder).rglob('*.glb'))} bytes of GLB")
    assert [record.seconds for record in again] == [record.seconds for record in records[:2]]
    for record in sorted(records, key=lambda record: record.confidence):
        print(f"{Path(record.job.figure).name}: {record.state}, confidence {record.confidence:.2f}")
    return [record.state for record in records]


if __name__ == "__main__":
    main()
