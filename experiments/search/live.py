"""``activetouch live``: a robot that nobody here owns runs a search over lines of JSON."""

from __future__ import annotations

import ipaddress
import re
import socket
import socketserver
import sys
import threading
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from activetouch import TactileSensor
from activetouch.named_scenes import SCENES
from activetouch.sensor_files import INDEPENDENT_SUFFIX, RECORDED_FILE
from experiments.command_line.arguments import BadArgument, Count, NotNegative, Seed, check_arguments
from experiments.scene_choice import SceneChoice
from experiments.search.live_protocol import Conversation, converse, requests
from experiments.search.one_search import session_with
from experiments.sensor_choice import open_sensor, sensor_folder

_MOST_CLIENTS = 16
_HTTP = re.compile(rb"[A-Z]+ \S+ HTTP/")


@dataclass(frozen=True)
class Live:
    """Run a search that a robot carries out: questions and answers as lines of JSON on standard input and output.

    All that is told is on disk before the next question. The same command with the same --log goes on after a crash.
    docs/drive_a_robot.md describes the lines.

    For example:

        activetouch live --sensor coarse --target cone --objects 4 --log today.jsonl
        activetouch live --sensor my_sensor --target mug --serve 127.0.0.1:7007
    """

    target: str
    """Shape to search for."""
    sensor: Path | None = None
    """Folder of a sensor, or name of a shipped one; that of the scene by default."""
    choice: tyro.conf.OmitArgPrefixes[SceneChoice] = field(default_factory=SceneChoice)
    """The scene; for a shipped sensor its own by default."""
    objects: Count | None = None
    """Objects on the table; that of the scene by default."""
    composition: Literal["distinct", "independent"] | None = None
    """distinct: all objects have different shapes. independent: each object can have any shape."""
    decider: str = "information_gain"
    """Decider, as of compare."""
    touch_cost: NotNegative = 0.02
    """Cost λ of one touch, in units of a success."""
    seed: Seed = 0
    """Seed of the decider."""
    never_unsure: bool = False
    """Forbid the answer "I do not know": a strange sensor then gives confident answers."""
    least_force: NotNegative | None = None
    """A contact whose stated force is not larger is no contact [N]."""
    least_area: NotNegative | None = None
    """A contact whose area is not larger is no contact [m²]."""
    log: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File for all that is told; a search that it holds goes on, and keeps its own limits.
    By default a new one in runs/live."""
    serve: str | None = None
    """HOST:PORT to listen on, instead of standard input; port 0 takes a free one."""
    open_to_network: bool = False
    """Listen on an address that other machines reach; there is no password."""
    anyway: bool = False
    """Accept a sensor that was made for another scene."""
    unknown_state: bool = False
    """Infer from the touches what is the matter with the sensor: forces, stiffness, noise, broken taxels, a shifted
    image. Needs a reader of any object."""

    def run(self) -> None:
        """Answer requests until the input ends."""
        check_arguments(self)
        address = None if self.serve is None else _address(self.serve, self.open_to_network)
        sensor = self._open()
        log = self.log if self.log is not None else Path(f"runs/live/{time.strftime('%Y-%m-%d-%H%M%S')}.jsonl")
        session = session_with(
            sensor,
            self.target,
            self.decider,
            self.seed,
            self.objects,
            self.composition,
            self.touch_cost,
            log,
            abstain=not self.never_unsure,
            least_force=self.least_force,
            least_area=self.least_area,
        )
        print(f"log: {log}" + f", goes on at step {session.step}" * bool(session.step), file=sys.stderr)
        conversation = Conversation(session, sensor)
        try:
            if address is None:
                converse(conversation, sys.stdin.buffer, sys.stdout.buffer)
            else:
                with Server(address, conversation) as server:
                    port = server.socket.getsockname()[1]
                    print(f"listening on {address[0]} port {port}", file=sys.stderr, flush=True)
                    server.serve_forever()
        finally:
            session.close()

    def _open(self) -> TactileSensor:
        choice, given = self.choice, self.sensor
        if given is not None and (sensor_folder(given, "") / RECORDED_FILE).exists():
            return TactileSensor.load(sensor_folder(given, ""))
        of_scene = "" if given is None or given.exists() else str(given).removesuffix(INDEPENDENT_SUFFIX)
        if of_scene in SCENES and choice.scene == SceneChoice.scene:
            choice = replace(choice, scene=of_scene)
        return open_sensor(given, choice, self.anyway, unknown_state=self.unknown_state)


class Server(socketserver.ThreadingTCPServer):
    """Clients of one session, each with a thread; their requests are answered one after the other.

    Args:
        address: host and port.
        conversation: that answers.
    """

    allow_reuse_address = True
    daemon_threads = True

    def __init__(self, address: tuple[str, int], conversation: Conversation) -> None:
        self.address_family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self.conversation, self.places = conversation, threading.BoundedSemaphore(_MOST_CLIENTS)
        super().__init__(address, _Client)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that goes away is no error."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Client(socketserver.StreamRequestHandler):
    server: Server

    def handle(self) -> None:
        """Answer the lines of one client."""
        if not self.server.places.acquire(blocking=False):
            return
        try:
            for line in requests(self.rfile):
                if line is not None and _HTTP.match(line):  # a page in a browser must not drive a robot
                    return
                self.wfile.write(self.server.conversation.answer(line))
        finally:
            self.server.places.release()


def _address(given: str, open_to_network: bool) -> tuple[str, int]:
    """Host and port of ``HOST:PORT``.

    Raises:
        BadArgument: it is no such address, or one that other machines reach and nobody allowed that.
    """
    host, _, port = given.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not re.fullmatch(r"\d{1,5}", port) or int(port) > 65535:
        raise BadArgument(f"--serve must be HOST:PORT, such as 127.0.0.1:7007; got {given!r}")
    try:
        found = {entry[4][0] for entry in socket.getaddrinfo(host, int(port), type=socket.SOCK_STREAM)}
    except OSError as error:
        raise BadArgument(f"--serve {given}: {host} is no address of this machine: {error}") from error
    if not open_to_network and not all(ipaddress.ip_address(str(one).split("%")[0]).is_loopback for one in found):
        raise BadArgument(
            f"--serve {given}: other machines could drive the robot; listen on 127.0.0.1, or add --open-to-network"
        )
    return str(sorted(found, key=lambda one: ":" in str(one))[0]), int(port)
