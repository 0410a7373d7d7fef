"""Who may talk to a page that is served on this machine: the page itself, nobody else's."""

from __future__ import annotations

from collections.abc import Sequence

HOST = "127.0.0.1"
HOSTS = (HOST, "localhost")


def is_own(hosts: Sequence[str] | None, origins: Sequence[str] | None, port: int) -> bool:
    """Whether a request is of the page that this very server has given out.

    A browser names the page that asks as the origin; another site's, or another local port's, is
    refused, and so is a name that another site lets lead to this machine.

    Args:
        hosts, origins: values of the headers Host and Origin; None or empty where there is none.
        port: of the server.
    """
    own = [f"{host}:{port}" for host in HOSTS]
    pages = [f"http://{host}" for host in own]
    here = hosts is not None and len(hosts) == 1 and hosts[0] in own
    return here and (not origins or (len(origins) == 1 and origins[0] in pages))
