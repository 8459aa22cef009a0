"""A meshcat scene as one page of HTML that plays without a server or a network."""

from __future__ import annotations

import base64
import html
from pathlib import Path
from typing import Any

from planner.collada import one_material_each


class Recorder:
    """Stands in for meshcat's window: keeps the commands instead of sending them to a server.

    Attributes:
        caption: What the page says about the motion.
        legend: Names of the colors that need one, as 0xRRGGBB.
        commands: meshcat's commands in the order in which they were given.
    """

    def __init__(self, caption: str, legend: dict[int, str]) -> None:
        self.caption = caption
        self.legend = legend
        self.commands: list[dict[str, Any]] = []

    def send(self, command: Any) -> None:
        """Keeps one of meshcat's commands."""
        lowered = command.lower()
        contents = lowered.get("object")
        if isinstance(contents, dict):
            whole = contents.get("object")
            parts = [*contents.get("geometries", ()), whole if isinstance(whole, dict) else {}]
            for part in parts:
                if part.get("format") == "dae" and isinstance(part.get("data"), str):
                    part["data"] = one_material_each(part["data"])
        self.commands.append(lowered)

    def get_scene(self) -> str:
        """Returns the scene as one page of HTML that needs no server and no network."""
        import meshcat
        from meshcat.visualizer import umsgpack

        viewer = Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js"
        data = "data:application/octet-binary;base64,"
        packed = [
            f'"{data}{base64.b64encode(umsgpack.packb(command)).decode()}"'
            for command in self.commands
        ]
        keys = [
            f'<span style="color: #{color:06x}">&#9644;</span> {html.escape(name)}'
            for color, name in self.legend.items()
        ]
        page = _PAGE.replace("CAPTION", html.escape(self.caption)).replace(
            "LEGEND", " &ensp; ".join(keys)
        )
        page = page.replace("COMMANDS", ",\n".join(packed))
        return page.replace("VIEWER", viewer.read_text(encoding="utf-8"))


# meshcat's own static page starts one download per command and leaves their order to chance; here
# they are carried out one after the other.
_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>CAPTION</title>
<style>
body { margin: 0; }
#meshcat-pane { width: 100vw; height: 100vh; overflow: hidden; }
#caption { position: absolute; left: 0; bottom: 0; padding: 0.7em 1em; pointer-events: none;
  font: 15px/1.5 system-ui, sans-serif; color: #333a44; }
</style>
</head>
<body>
<div id="meshcat-pane"></div>
<div id="caption">CAPTION<br>LEGEND</div>
<script>
VIEWER
</script>
<script>
const viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
for (const command of [
COMMANDS
]) {
  const data = atob(command.split(",")[1]);
  viewer.handle_command_bytearray(Uint8Array.from(data, (c) => c.charCodeAt(0)));
}
</script>
</body>
</html>
"""
