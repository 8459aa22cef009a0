"""Places that the command line writes to, looked at before any work is done."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from planner.errors import InputError

PLOT_SUFFIXES = (".png", ".svg", ".pdf")  # those of planner.plots, which takes long to import


def refuse_places(out: Path | None, html: Path | None, plot: Path | None) -> None:
    """Refuses places at which nothing can be written.

    Args:
        out: Folder of the plan, which may have to be made.
        html: File of the page, likewise its folder.
        plot: File of the picture, likewise.

    Raises:
        InputError: A place is of the wrong kind, or not writable.
    """
    if plot is not None and plot.suffix.lower() not in PLOT_SUFFIXES:
        raise InputError(
            "plots are not written in this format",
            source=plot,
            key="--plot",
            value=plot.suffix,
            remedy="end the name in .png, .svg or .pdf",
        )
    for option, place in (("--out", out), ("--html", html), ("--plot", plot)):
        if place is None:
            continue
        folder = place if option == "--out" else place.parent
        if option != "--out" and place.is_dir():
            raise InputError("is a folder", source=place, key=option, remedy="name a file in it")
        # the nearest folder that exists is where the missing ones would be made
        standing = next(part for part in (folder, *folder.absolute().parents) if part.exists())
        if not standing.is_dir():
            raise InputError(
                "is a file, not a folder" if standing == place else f"{standing} is no folder",
                source=place,
                key=option,
                remedy="name another place",
            )
        target = place if option != "--out" and place.exists() else standing
        if not os.access(target, os.W_OK):
            raise InputError(
                f"{target} is not writable", source=place, key=option, remedy="name another place"
            )


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Names the place where writing fails after all.

    Raises:
        InputError: The disk is full, or the place has changed.
    """
    try:
        yield
    except OSError as error:
        raise InputError(
            f"cannot be written: {error.strerror or error}",
            source=error.filename or path,
            remedy="name another place",
        ) from None
