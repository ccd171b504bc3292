"""Two controllers on the same suite and the same plant: what differs, and is it more than noise?

    python examples/compare_controllers/compare_controllers.py [FOLDER]

Every trial is repeated with its own seeds; a difference counts where its interval leaves zero, with
all metrics judged together. The pages are in FOLDER (default: reports/example_controllers).
"""

from __future__ import annotations

import sys
from pathlib import Path

import eha_bench as eb
from eha_bench.comparison.verdict import ComparisonVerdict

HERE = Path(__file__).resolve().parent


def main(folder: Path) -> int:
    """Run both, compare, print what differs; 0 where both could be run."""
    for name in ("tuned", "gentle"):
        result = eb.run(HERE / "suite.yaml", HERE / f"{name}-target.yaml", folder / name)
        print(f"{name}: {result.status.value}, {folder / name / 'report.html'}")
    found = eb.compare(folder / "tuned", folder / "gentle", folder / "comparison")
    counts = [f"{number} {word}" for word, number in found.counts().items() if number]
    print(f"gentle against tuned: {found.status} ({', '.join(counts)})")
    for item in found.of(ComparisonVerdict.BETTER, ComparisonVerdict.WORSE):
        print(f"  {item.trial} {item.metric}: {item.verdict} by {100 * abs(item.share):.1f} %")
    print(folder / "comparison" / "comparison.html")
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1] if len(sys.argv) > 1 else "reports/example_controllers")))
