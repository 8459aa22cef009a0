"""The command `planner`: plan, show, check, reproduce.

Everything it does is one call from Python. Exit status: 0 solved, 1 not solved, 2 bad input.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Optional

import typer

from planner import __version__
from planner.errors import InputError, PlannerError
from planner.places import refuse_places, writing

if TYPE_CHECKING:
    from planner.result import Plan
    from planner.scenario import Scenario

NOT_SOLVED = 1
BAD_INPUT = 2
INTERRUPTED = 130

# what can be read or written is found out here, not by typer (readable=False): its errors take
# several lines
app = typer.Typer(
    name="planner",
    help="Plans how two robot arms carry one object: motion, joint torques and hand forces.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

ScenarioFile = Annotated[
    Path,
    typer.Argument(
        metavar="SCENARIO", readable=False, help="TOML file that describes arms, object and task."
    ),
]
Settings = Annotated[
    Optional[list[str]],  # noqa: UP045 (typer reads it at run time)
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Sets a value over the scenario's, e.g. object.mass=8. May be repeated.",
    ),
]
Page = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option(
        "--html", metavar="FILE", readable=False, help="Writes the animated scene as one page."
    ),
]
Picture = Annotated[
    Optional[Path],  # noqa: UP045
    typer.Option(
        "--plot",
        metavar="FILE",
        readable=False,
        help="Draws path, torques and internal force: .png, .svg or .pdf.",
    ),
]
View = Annotated[bool, typer.Option("--view", help="Shows the motion in the browser.")]
NoBrowser = Annotated[
    bool,
    typer.Option("--no-browser", help="Prints the viewer's address and opens no browser."),
]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Prints nothing but errors.")]


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"planner {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Prints the version."
        ),
    ] = False,
) -> None:
    pass


@app.command()
def plan(
    scenario: ScenarioFile,
    settings: Settings = None,
    out: Annotated[
        Optional[Path],  # noqa: UP045
        typer.Option(
            "--out",
            metavar="DIR",
            readable=False,
            help="Writes plan.json and trajectory.npz there.",
        ),
    ] = None,
    view: View = False,
    no_browser: NoBrowser = False,
    html: Page = None,
    plot: Picture = None,
    quiet: Quiet = False,
) -> None:
    """Plans the motion and says what came of it."""
    refuse_places(out, html, plot)
    asked = _load(scenario, settings)

    from planner import planning
    from planner.outcome import Failure
    from planner.terminal import Progress, print_failure, print_plan, print_stale, screen

    terminal = screen(quiet=quiet)
    progress = Progress(terminal, asked)
    with _named(scenario):
        result = planning.plan(asked, progress=progress)
    if isinstance(result, Failure):
        if out is not None:
            with writing(out):
                result.save(out)
        print_failure(result, out)
        print_stale([file for file in (html, plot) if file is not None and file.exists()])
        raise typer.Exit(NOT_SOLVED)
    print_plan(terminal, result, heading=not progress.count)
    if out is not None:
        with writing(out):
            result.save(out)
        terminal.print(f"plan  {out / 'plan.json'}, {out / 'trajectory.npz'}")
    _draw(result, html, plot, quiet)
    if view:
        result.show(open_browser=not no_browser)


@app.command()
def show(
    folder: Annotated[
        Path,
        typer.Argument(metavar="DIR", readable=False, help="Folder written by planner plan --out."),
    ],
    view: View = False,
    no_browser: NoBrowser = False,
    html: Page = None,
    plot: Picture = None,
    quiet: Quiet = False,
) -> None:
    """Shows a saved plan: in the browser, or as a page or a picture where these are asked for."""
    refuse_places(None, html, plot)

    from planner.result import Plan
    from planner.terminal import print_plan, screen

    with _named(folder):
        saved = Plan.load(folder)
        print_plan(screen(quiet=quiet), saved)
        _draw(saved, html, plot, quiet)
        if view or (html is None and plot is None):
            saved.show(open_browser=not no_browser)


@app.command()
def check(scenario: ScenarioFile, settings: Settings = None) -> None:
    """Reads the scenario and its URDF files and says what is in them, missing or doubtful."""
    asked = _load(scenario, settings)

    from planner.examination import examine
    from planner.terminal import print_examination, screen

    found = examine(asked)
    print_examination(screen(), found)
    if not found.possible:
        raise typer.Exit(BAD_INPUT)


@app.command()
def reproduce(
    out: Annotated[
        Path,
        typer.Option(
            "--out", metavar="DIR", readable=False, help="Folder for figures, curves and report."
        ),
    ] = Path("out/reproduce"),
) -> None:
    """Computes the paper's figures and statements again and reports on each."""
    refuse_places(out, None, None)

    with writing(out):
        import_module("planner.reproduction.screen").show_reproduction(out)


def main() -> None:
    """Runs the command line and ends the process with its exit status."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # a title may hold letters that the terminal has not
            stream.reconfigure(errors="replace")
    try:
        app()
    except PlannerError as error:
        _print_error(error)
        sys.exit(BAD_INPUT if isinstance(error, InputError) else NOT_SOLVED)
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


def _print_error(error: PlannerError) -> None:
    typer.secho("error: ", fg=typer.colors.RED, nl=False, err=True)
    typer.echo(str(error), err=True)


def _load(path: Path, settings: list[str] | None) -> Scenario:
    from planner.scenario import load, parse_override

    with _named(Path("--set")):
        values = dict(parse_override(text) for text in settings or ())
    return load(path, values)


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Names the file at fault in errors that name none."""
    try:
        yield
    except InputError as error:
        if error.source is not None:
            raise
        raise type(error)(
            error.problem, source=path, key=error.key, value=error.value, remedy=error.remedy
        ) from None


def _draw(result: Plan, html: Path | None, plot: Path | None, quiet: bool) -> None:
    from planner.terminal import screen

    terminal = screen(quiet=quiet)
    if plot is not None:
        from planner.plots import write_plots

        with writing(plot):
            files = write_plots(result, plot)
        terminal.print(f"plot  {', '.join(str(file) for file in files)}")
    if html is not None:
        from planner.viewer import write_html

        with writing(html):
            write_html(result, html)
        terminal.print(f"page  {html} (open it in a browser)")
