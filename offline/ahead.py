"""Kernels, so that a program can compile them before the first render, side by side in several
processes.

Kernels that are not compiled ahead are compiled when they are first called. Nothing in `offline`
starts processes.
"""

from importlib import import_module

from .numerics.compile import kernels, writable_cache

# Those that take longest to compile come first, so that several processes end at about the same
# time.
_LONGEST = "solve_fields", "average", "denoise", "fill_blocks", "shrink_once"


def kernels_to_compile() -> list[str]:
    """Names of the kernels that are neither loaded nor on the disk yet; those of bursts are known
    once `offline.burst` is imported.

    Returns
    -------
    list[str]
        Those that take longest first.

    Raises
    ------
    OutputError
        When there are some, and no folder to keep them in.

    Examples
    --------
    >>> from panchroma.offline import compile_kernel, kernels_to_compile
    >>> compile_kernel("mix")
    >>> "mix" in kernels_to_compile()
    False
    """
    names = [name for name, kernel in kernels.items() if not (kernel.compiled or kernel.kept())]
    if names:
        writable_cache()
    return sorted(names, key=lambda name: ((*_LONGEST, name).index(name), name))


def compile_kernel(name: str) -> None:
    """Compile a kernel and keep it on the disk; reads it if it is there already.

    Raises
    ------
    KeyError
        For an unknown name.

    Examples
    --------
    >>> from panchroma.offline import compile_kernel
    >>> compile_kernel("mix")
    """
    import_module(f"{__package__}.burst")  # a kernel is known once its module is imported
    kernels[name].compile()
