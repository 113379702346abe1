"""The files of an evaluation: the page and the tables."""

from pathlib import Path

from shared.writing import write_durably

from .figures import Figures
from .page.gallery import render_gallery
from .page.page import build_page
from .tables import encode_csv, encode_json
from .team import Team


def write_tables(figures: Figures, program: str, failures: list[str], json: Path, csv: Path, *, overwrite: bool) -> None:
    """Write all figures as JSON and CSV. Raises OutputError as `write_durably` does."""
    write_durably(json, encode_json(figures, program, failures), overwrite=overwrite)
    write_durably(csv, encode_csv(figures), overwrite=overwrite)


def write_report(figures: Figures, program: str, failures: list[str], path: Path, team: Team, *, overwrite: bool) -> None:
    """Write the page; the team renders its gallery. Raises OutputError as `write_durably` does."""
    exhibits = render_gallery(figures, team)
    write_durably(path, build_page(figures, exhibits, program, failures).encode(), overwrite=overwrite)
