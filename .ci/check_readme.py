"""Fails when the README shows a command, an option, a file or a Python name that is not there."""

import ast
import importlib
import re
import shlex
import subprocess
import sys
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FENCE = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\((?!https?:|mailto:|#)([^)#\s]+)|<img[^>]*\ssrc=\"(?!https?:)([^\"]+)\"")
PLACEHOLDER = re.compile(r"[A-Z]+|.*[<>{}…].*|.*\.\.\..*")


@cache
def help_of(*command: str) -> str | None:
    """Returns what the planner prints for --help, or None for a command it does not have."""
    done = subprocess.run(
        [sys.executable, "-m", "planner", *command, "--help"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        # Wide and plain, so that no option is cut or split by colours.
        env={"PATH": "/usr/bin:/bin", "COLUMNS": "200", "TERM": "dumb", "NO_COLOR": "1"},
    )
    return done.stdout if done.returncode == 0 else None


def check_command(line: str) -> list[str]:
    """Returns what is wrong with one line of a shell block."""
    words = shlex.split(line.removeprefix("$ "), comments=True)
    while words and re.fullmatch(r"[A-Z_]+=\S*", words[0]):
        words.pop(0)
    if not words:
        return []
    wrong = []
    script = words[0].removeprefix("./")
    if script.startswith((".ci/", "scripts/")) and not (ROOT / script).is_file():
        wrong.append(f"no file {script}")
    if words[:3] == ["python", "-m", "planner"]:
        words = ["planner", *words[3:]]
    if script == "scripts/demo":
        words = ["planner", "plan", *words[1:]]
    if words[0] != "planner" or len(words) < 2:
        return wrong
    command = () if words[1].startswith("-") else (words[1],)
    text = help_of(*command)
    if text is None:
        return [*wrong, f"no command planner {words[1]}"]
    for word in words[1:]:
        option = word.partition("=")[0]
        if option.startswith("--") and not re.search(rf"{option}(?![\w-])", text):
            wrong.append(f"planner {' '.join(command)} has no option {option}")
        elif word.endswith(".toml") and not PLACEHOLDER.fullmatch(word):
            wrong += [] if (ROOT / word).is_file() else [f"no scenario {word}"]
    return wrong


def check_python(block: str) -> list[str]:
    """Returns what is wrong with one Python block: its syntax and the names of planner it uses."""
    try:
        tree = ast.parse(block)
    except SyntaxError as error:
        return [f"Python block: {error}"]
    wrong = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            names = [("planner", node.attr)] if node.value.id == "planner" else []
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("planner"):
            names = [(node.module, alias.name) for alias in node.names]
        else:
            names = []
        for module, name in names:
            if not hasattr(importlib.import_module(module), name):
                wrong.append(f"Python block: {module} has no {name}")
    return wrong


def main(readme: Path) -> int:
    """Prints what is wrong with the README and returns the exit status."""
    text = readme.read_text(encoding="utf-8")
    wrong, commands = [], 0
    for language, block in FENCE.findall(text):
        if language in ("bash", "sh", "shell", "console"):
            for line in block.replace("\\\n", " ").splitlines():
                if language == "console" and not line.startswith("$ "):
                    continue
                commands += 1
                wrong += check_command(line)
        elif language in ("python", "py"):
            wrong += check_python(block)
    for target in (first or second for first, second in LINK.findall(text)):
        if not (ROOT / target).exists():
            wrong.append(f"no file {target}")
    for script in ("scripts/demo", "scripts/test"):
        if script not in text:
            wrong.append(f"does not show {script}")
    for problem in wrong:
        print(f"{readme.name}: {problem}")
    print(f"{commands} lines of commands, {len(wrong)} problems")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
