"""Second names under which files stay that are about to be replaced."""

import os
import shutil
from itertools import count
from pathlib import Path

from ...shared.errors import OutputError
from ...shared.writing import durable_file


def keep_old(path: Path) -> Path:
    """Give a file a second name, under which its content stays when `path` is replaced: returns that name.

    It is the first free one of NAME.bak, NAME.bak2, ...: no earlier copy is ever replaced. On a file system without hard links the
    content is copied. Raises OutputError.
    """
    for number in count(1):
        spare = path.with_name(f"{path.name}.bak{number if number > 1 else ''}")
        try:
            os.link(path, spare)
        except FileExistsError:
            if spare.is_symlink() or not spare.samefile(path):  # a link to `path` would lead to the new file
                continue
        except OSError:  # no hard links here (FAT, some network shares)
            try:
                with path.open("rb") as old, durable_file(spare) as copy:
                    shutil.copyfileobj(old, copy)
            except OutputError:
                if os.path.lexists(spare):
                    continue
                raise
            except OSError as error:
                raise OutputError(f"{path}: cannot be read, to keep it as {spare.name} ({error.strerror or error})") from error
        break
    return spare
