"""The server of the page: what may be asked of it, by whom, and how it starts and ends.

It listens on this machine alone.  A request is refused where its Host or Origin is another's, or
where it has not the token of the address that was opened: a page of the net cannot ask it, and
neither can another user of this machine.  No address names a file; the text of a case that
is sent may name files, as one on the command line may.
"""

from __future__ import annotations

import asyncio
import json
import secrets
import socket
import sys
import time
import webbrowser
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.resources import files
from threading import Thread
from typing import TYPE_CHECKING, Any

from cosim.errors import CosimError, InputError
from cosim.extras import require
from cosim.json_text import json_text
from cosim.report.templates import html_page, report_file
from cosim.ui.controls import shipped
from cosim.ui.desk import Desk

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from uvicorn import Server

HERE = "127.0.0.1"
NAMES = (HERE, "localhost")
"""What this machine is called in an address."""
ALIVE = 15.0
"""s after which a tab is told that the server lives."""
SHUT = 1
"""s that open requests have to end in, once the server stops."""
POLICY = (
    "default-src 'none'; script-src 'self' 'unsafe-eval'{inline}; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""What the page may load: from this server alone.  Plotly makes functions of texts, and a report
has its scripts within it."""
REFUSED = "This page is for the one who started it: open the address that `cosim ui` has printed."
MOST_BODY = 4_000_000
Action = Callable[[Desk, Mapping[str, Any]], Any]

ACTIONS: Mapping[str, Action] = {
    "change": lambda desk, body: desk.change(
        str(body["key"]), str(body["text"]), body.get("drag") is True
    ),
    "reset": lambda desk, body: desk.reset(),
    "hood": lambda desk, body: desk.choose_hood(str(body["rung"])),
    "open": lambda desk, body: desk.open_packaged(str(body["name"])),
    "upload": lambda desk, body: desk.open_text(str(body["name"]), str(body["text"])),
    "solve": lambda desk, body: desk.solve(),
    "stop": lambda desk, body: desk.stop(),
    "pin": lambda desk, body: desk.pin(),
    "unpin": lambda desk, body: desk.unpin(),
    "save": lambda desk, body: desk.save(),
}
"""What a tab may have done, by the last part of the address."""


def application(desk: Desk, token: str, port: int) -> Starlette:
    """The application of a desk, for who has the token, at a port of this machine."""
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.responses import RedirectResponse, Response, StreamingResponse
    from starlette.routing import Route

    def reply(content: Any, status: int = 200) -> Response:
        text = json_text(content, None, ensure_ascii=True)
        return Response(text, status, media_type="application/json")

    async def page(request: Request) -> Response:
        if "token" in request.query_params:
            response: Response = RedirectResponse("/", 303)
            response.set_cookie(_cookie(port), token, httponly=True, samesite="strict")
            return response
        text = html_page("page.html.j2", "cosim.ui", name=desk.state()["case"])
        return Response(text, media_type="text/html")

    async def script(request: Request) -> Response:
        from plotly.offline import get_plotlyjs

        name = request.path_params["name"]
        text = {
            "plotly.js": get_plotlyjs,
            "scene.js": lambda: report_file("scene.js"),
            "app.js": lambda: files("cosim.ui").joinpath("app.js").read_text(encoding="utf-8"),
        }.get(name)
        if text is None:
            return reply({"error": "no such script"}, 404)
        return Response(text(), media_type="text/javascript")

    async def state(request: Request) -> Response:
        return reply(desk.state())

    async def controls(request: Request) -> Response:
        return reply(desk.controls())

    async def cases(request: Request) -> Response:
        return reply(await asyncio.to_thread(shipped))

    async def drawn(request: Request) -> Response:
        return reply(await asyncio.to_thread(desk.drawn))

    async def events(request: Request) -> Response:
        return StreamingResponse(_states(desk), media_type="text/event-stream")

    async def act(request: Request) -> Response:
        action = ACTIONS.get(request.path_params["action"])
        if action is None:
            return reply({"error": "no such action"}, 404)
        try:
            body = await _body(request)
            said = await asyncio.to_thread(action, desk, body)
        except KeyError as error:
            return reply({"error": f"{error.args[0]}: is missing"}, 400)
        except CosimError as error:
            return reply({"error": str(error)}, 400)
        return reply({"said": said})

    async def case(request: Request) -> Response:
        try:
            name, text = desk.case_text()
        except CosimError as error:
            return reply({"error": str(error)}, 400)
        head = {"Content-Disposition": f"attachment; filename*=UTF-8''{_quoted(name)}.toml"}
        return Response(text, headers=head, media_type="application/toml")

    async def report(request: Request) -> Response:
        try:
            file = await asyncio.to_thread(desk.report)
        except CosimError as error:
            text = html_page("refused.html.j2", "cosim.ui", why=str(error))
            return Response(text, 400, media_type="text/html")
        return Response(file.read_text(encoding="utf-8"), media_type="text/html")

    return Starlette(
        routes=[
            Route("/", page),
            Route("/script/{name}", script),
            Route("/state", state),
            Route("/controls", controls),
            Route("/cases", cases),
            Route("/drawn", drawn),
            Route("/events", events),
            Route("/case.toml", case),
            Route("/report", report),
            Route("/do/{action}", act, methods=["POST"]),
        ],
        middleware=[Middleware(_Guard, token=token, port=port)],
    )


class _Guard:
    """Refuses who is not on this machine, or has not the token."""

    def __init__(self, app: Any, token: str, port: int) -> None:
        self._app, self._token, self._port = app, token, port
        self._hosts = {f"{name}:{port}" for name in NAMES}
        self._origins = {f"http://{host}" for host in self._hosts}

    async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
        from starlette.requests import Request
        from starlette.responses import PlainTextResponse

        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        request = Request(scope)
        if not self._may(request):
            await PlainTextResponse(REFUSED, 403)(scope, receive, send)
            return
        inline = " 'unsafe-inline'" if request.url.path == "/report" else ""
        more = {
            "content-security-policy": POLICY.format(inline=inline),
            "cache-control": "no-store",
            "referrer-policy": "no-referrer",
            "x-content-type-options": "nosniff",
            "cross-origin-resource-policy": "same-origin",
        }

        async def sending(message: Any) -> None:
            if message["type"] == "http.response.start":
                pairs = [(k.encode(), v.encode()) for k, v in more.items()]
                message["headers"] = [*message["headers"], *pairs]
            await send(message)

        await self._app(scope, receive, sending)

    def _may(self, request: Request) -> bool:
        head = request.headers
        if len(head.getlist("host")) != 1 or head.get("host", "").lower() not in self._hosts:
            return False
        origin = head.get("origin")
        if origin is None:
            if request.method not in ("GET", "HEAD"):
                return False
        elif origin.lower() not in self._origins:
            return False
        given = [request.cookies.get(_cookie(self._port)), head.get("x-cosim-token")]
        if request.url.path == "/":
            given.append(request.query_params.get("token"))
        known = self._token.encode()
        return any(secrets.compare_digest(g.encode(), known) for g in given if g is not None)


def _cookie(port: int) -> str:
    """The name of the cookie, which a server at another port does not share."""
    return f"cosim-{port}"


def _quoted(name: str) -> str:
    from urllib.parse import quote

    return quote(name, safe="")


async def _body(request: Request) -> Mapping[str, Any]:
    """The JSON of a request, a table.  Raises InputError."""
    content = b""
    async for part in request.stream():
        content += part
        if len(content) > MOST_BODY:
            raise InputError("this is larger than a case file")
    try:
        body = json.loads(content or b"{}")
    except (ValueError, RecursionError):
        raise InputError("the request is no JSON") from None
    match body:
        case dict():
            return body
    raise InputError("the request is no table")


async def _states(desk: Desk) -> AsyncIterator[str]:
    """The state after every change, as server-sent events, until the desk is closed."""
    loop, changed = asyncio.get_running_loop(), asyncio.Event()

    def tell() -> None:
        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(changed.set)

    end = desk.listen(tell)
    try:
        while not desk.is_closed:
            changed.clear()
            yield f"data: {json_text(desk.state(), None, ensure_ascii=True)}\n\n"
            try:
                await asyncio.wait_for(changed.wait(), ALIVE)
            except TimeoutError:
                yield ": alive\n\n"
    finally:
        end()


@contextmanager
def listening(port: int) -> Iterator[socket.socket]:
    """A socket at a port of this machine (0: a free one).  Raises InputError where it is taken."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as at:
        if sys.platform != "win32":  # where it would let two servers share a port
            at.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            at.bind((HERE, port))
        except OSError as error:
            raise InputError(
                f"--port {port}: cannot be listened on ({error.strerror or error}); write another "
                "one, or leave it out for a free one"
            ) from None
        at.listen()
        yield at


@contextmanager
def serving(desk: Desk, port: int, opens: bool, say: Callable[[str], None]) -> Iterator[Thread]:
    """The page of a desk, served for the block by a thread; it `opens` in the browser, and `say`
    hears its address.  Raises InputError."""
    require("the page", "starlette", "uvicorn")
    with listening(port) as at:
        server, address = _server(desk, at)
        thread = Thread(target=_run, args=(server, at), daemon=True)
        thread.start()
        say(f"the page is at {address} (for you alone; Ctrl-C ends it)")
        if opens:
            webbrowser.open_new_tab(address)
        try:
            yield thread
        finally:
            desk.close()
            server.should_exit = True
            thread.join()


def _server(desk: Desk, at: socket.socket) -> tuple[Server, str]:
    import uvicorn

    port, token = at.getsockname()[1], secrets.token_urlsafe(24)
    config = uvicorn.Config(
        application(desk, token, port),
        log_level="error",
        access_log=False,
        lifespan="off",
        server_header=False,
        timeout_graceful_shutdown=SHUT,
    )
    return uvicorn.Server(config), f"http://{HERE}:{port}/?token={token}"


def _run(server: Server, at: socket.socket) -> None:
    run: Awaitable[None] = server.serve(sockets=[at])
    asyncio.run(run)  # type: ignore[arg-type]


def wait_for_end() -> None:
    """Return when the user presses Ctrl-C, or the program is asked to end (SIGTERM)."""
    with suppress(KeyboardInterrupt):
        while True:
            time.sleep(1.0)  # a longer one would not see a signal on Windows
