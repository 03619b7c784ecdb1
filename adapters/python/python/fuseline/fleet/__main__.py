"""Makes the page of a fleet: ``python -m fuseline.fleet rows.parquet -o fleet.html``."""

from __future__ import annotations

import argparse
import sys

from fuseline.fleet import report


def main() -> int:
    """Makes the page. Returns 2 if it cannot be made."""
    parser = argparse.ArgumentParser(prog="python -m fuseline.fleet")
    parser.description = "Makes a page of the rows of a fleet that are kept in Parquet."
    parser.add_argument("rows", help="a Parquet file, a folder of them, or a pattern")
    parser.add_argument("-o", "--output", default="fleet.html", help="the page (fleet.html)")
    parser.add_argument("--title", default="Fleet", help="its title")
    given = parser.parse_args()
    try:
        report(given.rows, given.output, title=given.title)
    except (ImportError, OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
