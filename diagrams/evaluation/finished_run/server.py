"""Serves the page of a finished run to this machine, and nothing that is not of the run."""

import contextlib
import json
import threading
from functools import cache, cached_property
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from crossmodal.diagrams.drawing.estimate_plots import draw_estimates
from crossmodal.diagrams.drawing.legend import KEEPS_BOARDS
from crossmodal.diagrams.drawing.page import png_address, render
from crossmodal.diagrams.drawing.palette import estimator_color
from crossmodal.diagrams.drawing.plot_style import panels_over_time, save
from crossmodal.diagrams.evaluation.finished_run.read_run import FinishedRun, values_over_time
from crossmodal.diagrams.run.folder.run_folder import MESHCAT_FILE
from crossmodal.diagrams.run.folder.written_files import is_within
from crossmodal.diagrams.run.yaml_input.schema import ScenarioError, one_line

HOST = "127.0.0.1"
_HERE = Path(__file__).parent
# The page loads nothing from elsewhere. Meshcat's recording, which may be anybody's, runs in a
# frame without an origin, from where it reaches neither this server nor any other one.
_POLICY = "default-src 'self'; img-src 'self' data:; style-src 'self' 'unsafe-inline'"
_SCENE_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:;"
    " style-src 'unsafe-inline'; img-src data: blob:; font-src data:; connect-src data: blob:;"
    " worker-src blob:"
)
_JSON, _HTML = "application/json", "text/html; charset=utf-8"


class RunServer(ThreadingHTTPServer):
    """The page of a run on localhost, `serve_forever()` until `shutdown()`.

    Args:
        run: What is shown.
        port: Of the page; 0 for a free one.

    Raises:
        ScenarioError: where it cannot listen at that port.
    """

    daemon_threads = True

    def __init__(self, run: FinishedRun, port: int = 0) -> None:
        self._run, self._lock = run, threading.Lock()
        self._drawn = cache(self._draw)
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            reason = one_line(error.strerror or error)
            raise ScenarioError(f"--port {port}: cannot be listened at: {reason}") from None

    @property
    def url(self) -> str:
        return f"http://localhost:{self.server_port}/"

    def answer(self, path: str) -> tuple[str, str, bytes] | None:
        """Type, security policy and content of what a path asks for; None where there is none."""
        if path == "/":
            return _HTML, _POLICY, self._page
        if path == "/show.js":
            return "text/javascript", _POLICY, (_HERE / "show.js").read_bytes()
        if path == "/estimates.json":
            return _JSON, _POLICY, self._values
        if path == "/scene.html" and self._run.has_scene:
            scene, script = self._read(MESHCAT_FILE), (_HERE / "scene.js").read_text()
            added = f"{KEEPS_BOARDS}<script>{script}</script>".encode()
            return None if scene is None else (_HTML, _SCENE_POLICY, scene + added)
        if path.lstrip("/") in self._run.pictures:
            picture = self._read(path.lstrip("/"))
            return None if picture is None else ("image/png", _POLICY, picture)
        quantity = path.removeprefix("/plots/")
        if path.startswith("/plots/") and quantity in self._run.quantities:
            with self._lock:  # Matplotlib's style is the whole process'.
                return _JSON, _POLICY, self._drawn(quantity)
        return None

    def _read(self, name: str) -> bytes | None:
        folder = self._run.folder  # It may have changed since it was looked at.
        is_there = is_within(folder, name) and (folder / name).is_file()
        return (folder / name).read_bytes() if is_there else None

    @cached_property
    def _values(self) -> bytes:
        return json.dumps(values_over_time(self._run)).encode()

    @cached_property
    def _page(self) -> bytes:
        run = self._run
        legend = [
            (name, run.labels.get(name, name), estimator_color(run.colors, name, index))
            for index, name in enumerate(run.estimators)
        ]
        pictures = [
            {"name": Path(name).stem.replace("_", " "), "file": name, "panels": json.dumps(panels)}
            for name, panels in run.pictures.items()
        ]
        return render(_HERE / "show.html.jinja", run=run, legend=legend, pictures=pictures).encode()

    def _draw(self, quantity: str) -> bytes:
        """A plot of a quantity over time, ready for JSON: its address, and where time runs."""
        run = self._run
        chosen = run.estimates[run.estimates["quantity"] == quantity]
        figure = draw_estimates(
            run.estimates,
            quantity,
            list(dict.fromkeys(chosen["component"])),
            labels=run.labels,
            colors=run.colors,
        )
        png = BytesIO()
        save(figure, png)
        found = {"image": png_address(png.getvalue()), "panels": panels_over_time(figure)}
        return json.dumps(found).encode()


class _Handler(BaseHTTPRequestHandler):
    server: RunServer

    def do_GET(self) -> None:
        host = self.headers.get("Host", "").partition(":")[0]
        path = unquote(urlsplit(self.path).path)
        # Another name is one that a page from elsewhere has given to this machine.
        found = self.server.answer(path) if host in ("localhost", HOST) else None
        if found is None:
            self.send_error(HTTPStatus.NOT_FOUND)
            return
        kind, policy, content = found
        self.send_response(HTTPStatus.OK)
        for key, value in (
            ("Content-Type", kind),
            ("Content-Length", str(len(content))),
            ("Content-Security-Policy", policy),
            ("X-Content-Type-Options", "nosniff"),
            ("Cache-Control", "no-store"),
        ):
            self.send_header(key, value)
        self.end_headers()
        with contextlib.suppress(ConnectionError):  # The page may be closed meanwhile.
            self.wfile.write(content)

    def log_message(self, *_: Any) -> None:
        """A request is no news."""
