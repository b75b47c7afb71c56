"""Who may talk to the viewer: its own page, opened by the address that was printed, and nobody else.

A server on this machine can be reached by every web page that its user has open: browsers let any page open a web
socket to any address, and a name that a stranger owns may lead here (DNS rebinding). So every request has to carry
a secret that only the printed address holds, a page has to come from this server, and a server that listens on this
machine alone has to be called by a name of this machine.
"""

import contextlib
import http
import ipaddress
import secrets
from collections.abc import Callable, Iterator
from typing import Any
from unittest import mock
from urllib.parse import urlsplit

from websockets.asyncio import server as websocket_server
from websockets.datastructures import Headers, MultipleValuesError
from websockets.http11 import Request, Response

_REFUSED = "refused: open the address that `dsmap view` printed\n"


class Guard:
    """The secret of one server, and the check of every request that reaches it.

    Args:
        host: address that the server listens on.
    """

    def __init__(self, host: str):
        self.token = secrets.token_urlsafe(16)
        self.at_work = False
        """Whether a server was started behind it."""
        self._here_only = _is_of_this_machine(host)

    def refusal(self, path: str, headers: Headers) -> str | None:
        """Why a request is refused, in words; None where it is not.

        Args:
            path: as requested, with the secret as its first part.
        """
        given = path.partition("?")[0].split("/")[1:2]
        if not given or not secrets.compare_digest(given[0].encode(), self.token.encode()):
            return "it does not know the secret of the address"
        try:
            host, origin = headers.get("Host", ""), headers.get("Origin")
        except MultipleValuesError:
            return "it names several hosts or origins"
        if self._here_only and not _is_of_this_machine(_name_of(f"//{host}")):
            return f"it calls this machine {host!r}"
        if origin is not None and origin not in (f"http://{host}", f"https://{host}"):
            return f"it comes from a page of {origin!r}"
        return None

    def before(
        self, serve: Callable[[Any, Request], Response | None] | None
    ) -> Callable[..., Response | None]:
        """`process_request` of a server: refuses, or passes the path on without the secret."""

        def check(connection: Any, request: Request) -> Response | None:
            if self.refusal(request.path, request.headers) is not None:
                return _answer(http.HTTPStatus.FORBIDDEN, _REFUSED)
            rest = request.path.removeprefix(f"/{self.token}")
            answer = serve(connection, Request(rest or "/", request.headers)) if serve else None
            if answer is not None:
                answer.headers["Referrer-Policy"] = "no-referrer"
                answer.headers["X-Frame-Options"] = "DENY"
            return answer

        return check

    @contextlib.contextmanager
    def in_front(self) -> Iterator[None]:
        """A web socket server that is started inside is behind this guard: viser has no door of its own for it."""
        usual = websocket_server.serve

        def serve(handler: Any, *args: Any, process_request: Any = None, **options: Any) -> Any:
            self.at_work = True
            return usual(handler, *args, process_request=self.before(process_request), **options)

        with mock.patch.object(websocket_server, "serve", serve):
            yield


def _answer(status: http.HTTPStatus, text: str) -> Response:
    body = text.encode()
    headers = Headers({"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))})
    headers["Connection"] = "close"
    return Response(status.value, status.phrase, headers, body)


def _name_of(url: str) -> str:
    with contextlib.suppress(ValueError):
        return urlsplit(url).hostname or ""
    return ""


def _is_of_this_machine(name: str) -> bool:
    """Whether an address or name means this machine and can be reached from it alone."""
    if name.lower() == "localhost":
        return True
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(name.strip("[]")).is_loopback
    return False
