"""Thousands of spoiled inputs, read in children with limits; a fault is reported with the number that repeats it."""

import contextlib
import faulthandler
import json
import os
import random
import resource
import selectors
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cadtof_cli.errors import CadtofError
from tests.support.fuzz.readers import AN_ADDRESS, READERS, Reader, run_command
from tests.support.fuzz.samples import copy_of, make_sound
from tests.support.fuzz.spoil import spoiled

MOST_SECONDS, MOST_BYTES = 5.0, 512 * 2**20
"""Limits for one input: processor time in s, and memory in bytes. The time limit holds for waiting too."""

PER_CHILD = 50
"""Inputs that a child reads, one after the other."""

_BEYOND = 4 * 2**30
"""Bytes that a child may allocate besides those that it has: so a fault is found, and the machine survives."""


@dataclass(frozen=True)
class Finding:
    """A fault that an input caused; its kind is `hang`, `crash`, `exception`, `output` or `memory`."""

    reader: str
    number: int
    kind: str
    text: str

    def __str__(self) -> str:
        return f"{self.kind}: {self.reader}:{self.number}: {self.text}"


@dataclass
class Tally:
    """Result of a campaign: inputs by reader, how many were refused, the most memory, the longest time, findings."""

    inputs: dict[str, int] = field(default_factory=dict)
    refused: int = 0
    peak_bytes: int = 0
    longest_s: float = 0.0
    longest: str = ""
    findings: list[Finding] = field(default_factory=list)

    @property
    def total(self) -> int:
        """Number of inputs."""
        return sum(self.inputs.values())

    def count(self, kind: str) -> int:
        """Return the number of findings of a kind."""
        return sum(finding.kind == kind for finding in self.findings)


def input_of(reader: Reader, number: int, place: Path) -> bytes:
    """Return the input with this number, which is always the same."""
    rng = random.Random(f"{reader.name} {number}")
    return spoiled(rng.choice(reader.samples(place)), reader.ways, rng)


@contextlib.contextmanager
def sound_place() -> Iterator[Path]:
    """Make a folder of sound files, in memory where there is such a place with 256 MB. Containers often have less."""
    memory = Path("/dev/shm")
    roomy = os.access(memory, os.W_OK) and shutil.disk_usage(memory).free > 2**28
    with tempfile.TemporaryDirectory(prefix="fuzz-", dir=memory if roomy else None) as folder:
        yield make_sound(Path(folder) / "sound", run_command)


def run_campaign(
    readers: Sequence[str],
    place: Path,
    /,
    *,
    inputs: int,
    first: int = 0,
    seconds: float | None = None,
    jobs: int = 1,
    say: Callable[[str], None] = lambda _: None,
) -> Tally:
    """Read so many inputs, spread over the readers, or until the time is over."""
    tally, until = Tally(), None if seconds is None else time.monotonic() + seconds
    batches = _batches(readers, inputs, first)
    selector, running = selectors.DefaultSelector(), set[_Child]()
    while True:
        while len(running) < jobs and (until is None or time.monotonic() < until):
            batch = next(batches, None)
            if batch is None:
                break
            _start(_Child(*batch, place), selector, running)
        if not running:
            return tally
        for key, _ in selector.select(0.25):
            key.data.receive()
        for child in list(running):
            if child.is_done or child.is_late:
                selector.unregister(child.pipe)
                running.discard(child)
                found = child.end(tally)
                for finding in found:
                    say(str(finding))
                if child.next < child.first + child.count:
                    again = _Child(child.reader, child.next, child.first + child.count - child.next, place)
                    _start(again, selector, running)


def _batches(readers: Sequence[str], inputs: int, first: int) -> Iterator[tuple[str, int, int]]:
    """Yield readers in turn, the number of the first input of each batch, and how many it has."""
    share, rest = divmod(inputs, len(readers))
    for start in range(0, share + (rest > 0), PER_CHILD):
        for place, name in enumerate(readers):
            count = min(PER_CHILD, share + (place < rest) - start)
            if count > 0:
                yield name, first + start, count


def _start(child: "_Child", selector: selectors.BaseSelector, running: "set[_Child]") -> None:
    child.start()
    running.add(child)
    selector.register(child.pipe, selectors.EVENT_READ, child)


class _Child:
    """A process that reads a batch of inputs, and reports on a pipe which input it reads."""

    def __init__(self, reader: str, first: int, count: int, place: Path) -> None:
        self.reader, self.first, self.count, self._place = reader, first, count, place
        self.next = first
        self._rest, self._ended = b"", False
        self._used_s = self._last_used_s = self._waited_s = self._looked = 0.0
        self._messages: list[dict[str, object]] = []

    def start(self) -> None:
        """Fork the process."""
        self.pipe, writing = os.pipe()
        self._output = os.memfd_create("output")
        self._folder = Path(tempfile.mkdtemp(prefix="child-", dir=self._place.parent))
        self._pid = os.fork()
        if self._pid == 0:
            os.close(self.pipe)
            _serve(
                READERS[self.reader],
                range(self.first, self.first + self.count),
                self._place,
                self._folder,
                writing,
                self._output,
            )
        os.close(writing)
        self._at_next()

    @property
    def is_done(self) -> bool:
        """Whether it has ended."""
        return self._ended

    @property
    def is_late(self) -> bool:
        """Whether the input takes too long: in processor time, or in time that it waits."""
        state, used_s = self._state()
        now = time.monotonic()
        # on a busy machine this process may look rarely: one look shows the state now, not since the last look
        self._waited_s = (
            0.0 if state in "RZ" or used_s > self._last_used_s else self._waited_s + min(now - self._looked, 0.5)
        )
        self._last_used_s, self._looked = used_s, now
        return used_s - self._used_s > MOST_SECONDS or self._waited_s > MOST_SECONDS

    def _at_next(self) -> None:
        self._waited_s, self._looked = 0.0, time.monotonic()
        self._used_s = self._last_used_s = self._state()[1]

    def _state(self) -> tuple[str, float]:
        """Return the state of the child, a letter of the system, and the processor time in s that it has used."""
        words = Path(f"/proc/{self._pid}/stat").read_text().rpartition(")")[2].split()
        return words[0], (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")

    def receive(self) -> None:
        """Read the messages of the child."""
        content = os.read(self.pipe, 2**16)
        self._ended = not content
        *lines, self._rest = (self._rest + content).split(b"\n")
        for line in lines:
            message = json.loads(line)
            if "at" in message:
                self.next = message["at"]
                self._at_next()
            else:
                self._messages.append(message)

    def end(self, tally: Tally) -> list[Finding]:
        """Reap the child, count its inputs, and return its findings."""
        late = not self._ended
        if late:
            os.kill(self._pid, signal.SIGKILL)
        status = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
        printed = os.pread(self._output, 4000, 0).decode(errors="replace")
        os.close(self._output)
        os.close(self.pipe)
        shutil.rmtree(self._folder, ignore_errors=True)
        findings = self._findings_received(tally)
        if late:
            findings.append(Finding(self.reader, self.next, "hang", f"over {MOST_SECONDS:g} s"))
        elif status and not any(finding.number == self.next and finding.kind == "memory" for finding in findings):
            findings.append(Finding(self.reader, self.next, "crash", f"ended with {status}: {printed[-1500:]}"))
        # the input at which the child ended is not read again
        self.next += 1
        tally.inputs[self.reader] = tally.inputs.get(self.reader, 0) + self.next - self.first
        tally.findings += findings
        return findings

    def _findings_received(self, tally: Tally) -> list[Finding]:
        findings = []
        for message in self._messages:
            if "kind" in message:
                findings.append(
                    Finding(self.reader, int(str(message["number"])), str(message["kind"]), str(message["text"]))
                )
            else:
                tally.refused += int(str(message["refused"]))
                longest_s = float(str(message["longest_s"]))
                if longest_s > tally.longest_s:
                    tally.longest_s, tally.longest = longest_s, f"{self.reader}:{message['longest']}"
                tally.peak_bytes = max(tally.peak_bytes, int(str(message["peak_bytes"])))
        return findings


def _serve(reader: Reader, numbers: range, place: Path, folder: Path, pipe: int, output: int) -> None:
    """Read the inputs in the child, and end it."""
    status = 1
    try:
        _limit(output)
        here = copy_of(place, folder)
        os.chdir(here)
        read = _Reading(reader, place, here, pipe, output)
        for number in numbers:
            read(number)
        read.sum_up()
        status = 0
    finally:
        if status:
            traceback.print_exc()
        with contextlib.suppress(OSError, ValueError):
            sys.stderr.flush()
        os._exit(status)


def _limit(output: int) -> None:
    os.setsid()
    nowhere = os.open(os.devnull, os.O_RDONLY)
    for number, place in ((0, nowhere), (1, output), (2, output)):
        os.dup2(place, number)
    sys.stdout = os.fdopen(1, "w", encoding="utf-8", errors="backslashreplace", closefd=False)
    sys.stderr = os.fdopen(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False)
    faulthandler.enable(2)
    warnings.simplefilter("always")
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (used + _BEYOND, used + _BEYOND))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (2**30, 2**30))


class _Reading:
    """Reads one input after the other, and reports faults."""

    def __init__(self, reader: Reader, place: Path, here: Path, pipe: int, output: int) -> None:
        self._reader, self._place, self._here, self._pipe, self._output = reader, place, here, pipe, output
        self._refused, self._longest_s, self._longest = 0, 0.0, 0

    def __call__(self, number: int) -> None:
        self._send({"at": number})
        content = input_of(self._reader, number, self._place)
        began = time.process_time()
        try:
            self._reader.read(self._here, content)
        except CadtofError as error:
            self._refused += 1
            if AN_ADDRESS in str(error):
                self._find(number, "exception", str(error))
        except Exception:  # noqa: BLE001  (any exception but CadtofError is a finding)
            self._find(number, "exception", traceback.format_exc()[-3000:])
        took_s = time.process_time() - began
        if took_s > self._longest_s:
            self._longest_s, self._longest = took_s, number
        sys.stdout.flush()
        sys.stderr.flush()
        if size := os.fstat(self._output).st_size:
            self._find(number, "output", os.pread(self._output, min(size, 1500), 0).decode(errors="replace"))
            os.ftruncate(self._output, 0)
            os.lseek(self._output, 0, os.SEEK_SET)
        if peak_bytes() > MOST_BYTES:
            self._find(number, "memory", f"{peak_bytes() / 2**20:.0f} MB")
            self.sum_up()
            os._exit(1)

    def sum_up(self) -> None:
        """Report the totals of all inputs."""
        found = {"refused": self._refused, "longest_s": self._longest_s, "longest": self._longest}
        self._send({**found, "peak_bytes": peak_bytes()})

    def _find(self, number: int, kind: str, text: str) -> None:
        self._send({"number": number, "kind": kind, "text": text})

    def _send(self, message: dict[str, object]) -> None:
        os.write(self._pipe, json.dumps(message).encode() + b"\n")


def peak_bytes() -> int:
    """Return the peak memory of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
