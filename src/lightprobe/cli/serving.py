"""serve: predictions over HTTP for other programs."""

import os
from pathlib import Path
from typing import Annotated

from tyro.conf import FlagCreatePairsOff, Positional, arg

from lightprobe.cli.answer import say
from lightprobe.cli.options import option
from lightprobe.service.server import PORT, LogLevel, ServiceConfig, read_token
from lightprobe.service.server import serve as serve_folder

TOKEN = "LIGHTPROBE_TOKEN"

_Folder = Annotated[
    Positional[Path], option(metavar="RUNS", help="Folder of run folders; their names are the objects'.")
]
_Host = Annotated[
    str, option(metavar="ADDRESS", help="Address to listen on; 0.0.0.0 is all of this machine's.")
]
_Port = Annotated[int, option(metavar="N", help="Port of the service; 0 takes a free one.")]
_TokenFile = Annotated[
    Path | None,
    option(metavar="FILE", help=f"File with the token that requests must bring; else {TOKEN} may hold it."),
]
_Anyone = Annotated[
    FlagCreatePairsOff[bool],
    option(help="Answer whoever gets there without a token, where a proxy or a firewall decides who does."),
]
_Devices = Annotated[
    tuple[str, ...],
    option(metavar="DEVICE...", help="Where to compute: GPUs as cuda:0 cuda:1, a worker each; or cpu."),
]
_Workers = Annotated[
    int | None, option(metavar="N", help="Processes on the CPU; by default one for each two cores.")
]
_LIMITS = ServiceConfig()
_Settings = Annotated[ServiceConfig, arg(name="")]
_LogLevel = Annotated[
    LogLevel, option(metavar="debug|info|warning", help="What the log on standard error has.")
]


def serve(
    runs: _Folder,
    *,
    host: _Host = "127.0.0.1",
    port: _Port = PORT,
    token_file: _TokenFile = None,
    anyone: _Anyone = False,
    devices: _Devices = (),
    workers: _Workers = None,
    log_level: _LogLevel = LogLevel.INFO,
    settings: _Settings = _LIMITS,
) -> None:
    """Answer other programs over HTTP: a photo of an object in, its environment map, confidence and light
    file out.

    The interface is described at /openapi.json, and with examples in docs/serve.md. Logs are JSON lines on
    standard error. Ctrl-C or SIGTERM stops it: no new requests are taken, those that were accepted are
    finished. Needs the extra serve.

    Examples:
      lightprobe serve runs
      lightprobe serve runs --workers 4 --deadline 20 --queue 100
      lightprobe serve runs --host 0.0.0.0 --token-file token.txt
      lightprobe serve runs --devices cuda:0 cuda:1
    """
    token = read_token(token_file) if token_file is not None else os.environ.get(TOKEN) or None
    served = serve_folder(
        runs,
        host=host,
        port=port,
        token=token,
        anyone=anyone,
        devices=devices,
        workers=workers,
        config=settings,
        log_level=log_level,
        tell=lambda line: say(line, service=line.split()[1]),
    )
    say(f"{served.predictions} maps; {served.requests} requests answered.", **vars(served))
