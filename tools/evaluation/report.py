"""The files of an evaluation: page and tables."""

from pathlib import Path

from shared.writing import write_durably

from .figures import Figures
from .page.gallery import gallery
from .page.page import page
from .tables import encode_csv, encode_json
from .team import Team


def write_tables(figures: Figures, program: str, failures: list[str], json: Path, csv: Path, *, overwrite: bool) -> None:
    """All figures, for machines. Raises OutputError as `write_durably` does."""
    write_durably(json, encode_json(figures, program, failures), overwrite=overwrite)
    write_durably(csv, encode_csv(figures), overwrite=overwrite)


def write_report(figures: Figures, program: str, failures: list[str], path: Path, team: Team, *, overwrite: bool) -> None:
    """The page, with crops rendered by the team. Raises OutputError as `write_durably` does."""
    places = gallery(figures, team)
    write_durably(path, page(figures, places, program, failures).encode(), overwrite=overwrite)
