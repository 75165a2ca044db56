"""A command ends with one line, whoever ends it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bridge import processes
from bridge.processes import usable_cores

COMMAND = """
import errno, os, signal, sys, time
from bridge.processes import exit_with_one_line
with exit_with_one_line():
    {}
"""
WAITS = """
import sys, time
from pathlib import Path
Path(sys.argv[1]).touch()
time.sleep(60)
"""


both_signals = pytest.mark.parametrize(
    ("number", "how"), [(signal.SIGINT, "interrupted"), (signal.SIGTERM, "terminated")]
)


def ended(code: str) -> tuple[int, str]:
    done = subprocess.run(
        [sys.executable, "-c", COMMAND.format(code)], capture_output=True, text=True, check=False
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("raise OSError(errno.ENOSPC, 'No space', 'runs/x')", "runs/x: No space left on device;"),
        ("raise OSError(errno.EROFS, 'Read-only')", "dsnet: Read-only file system; expected a"),
        ("os.mkdir(sys.executable + '/x')", "Not a directory; expected a folder"),
        ("open('x' * 300)", "File name too long; expected names of at most 255 bytes"),
        ("raise OSError(errno.EMFILE, 'Too many')", "Too many open files; expected a process"),
        ("raise MemoryError", "expected enough memory"),
    ],
)
def test_what_the_system_refuses_is_one_line(code, words):
    status, said = ended(code)
    assert (status, said.count("\n")) == (2, 1), said
    assert words in said


def test_a_fault_of_the_program_is_none_of_these():
    for code in ("open('nowhere/x')", "r, w = os.pipe(); os.close(r); os.write(w, b'x')"):
        status, said = ended(code)
        assert status == 1
        assert "Traceback" in said


@both_signals
def test_a_signal_is_one_line(number, how):
    status, said = ended(f"signal.raise_signal({int(number)}); time.sleep(60)")
    assert (status, said) == (128 + number, f"dsnet: {how}; run the same command to go on\n")


SWALLOWS = """
import signal
try:
    signal.raise_signal(int(open("number").read()))
    sum(range(10))
except BaseException:
    pass
"""


@both_signals
def test_a_library_that_loads_swallows_no_signal(number, how, tmp_path):
    (tmp_path / "swallows.py").write_text(SWALLOWS)
    (tmp_path / "number").write_text(str(int(number)))
    code = f"""
import sys, time
sys.path[:0] = [{str(tmp_path)!r}, {str(Path.cwd())!r}]
from bridge.processes import exit_with_one_line
with exit_with_one_line():
    import swallows
    time.sleep(30)
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=20,
    )
    expected = (128 + number, f"dsnet: {how}; run the same command to go on\n")
    assert (done.returncode, done.stderr) == expected


@both_signals
def test_a_signal_while_a_wait_lets_go_of_its_lock_is_one_line(number, how):
    code = f"""import threading
    condition = threading.Condition()
    let_go = condition._release_save
    def and_then():
        saved = let_go()
        signal.raise_signal({int(number)})
        return saved
    condition._release_save = and_then
    with condition:
        condition.wait(30)"""
    assert ended(code) == (128 + number, f"dsnet: {how}; run the same command to go on\n")


@pytest.mark.parametrize(("step", "event"), [("__enter__", "c_return"), ("__exit__", "call")])
@both_signals
def test_no_signal_leaves_a_lock_taken(step, event, number, how):
    """A worker with a result for a future would wait for it, and the command for the worker."""
    code = f"""import threading
    condition, locking = threading.Condition(threading.Lock()), threading.Condition.{step}
    def interrupt(frame, event, _):
        if (frame.f_code, event) == (locking.__code__, "{event}"):
            sys.setprofile(None)
            signal.raise_signal({int(number)})
    sys.setprofile(interrupt)
    try:
        with condition:
            pass
        time.sleep(30)
    finally:
        if not condition.acquire(blocking=False):
            print("the lock stays taken", file=sys.stderr)"""
    assert ended(code) == (128 + number, f"dsnet: {how}; run the same command to go on\n")


LOST = {
    "another": """
    class Wraps:
        def __enter__(self): pass
        def __exit__(self, kind, interrupt, trace): raise RuntimeError("normalised") from interrupt
    with Wraps():
        signal.raise_signal({0})
        time.sleep(30)""",
    "finalizer": """
    class Ends:
        def __del__(self):
            signal.raise_signal({0})
            time.sleep(0)
    Ends()
    time.sleep(30)""",
    "weak reference": """
    import weakref
    class Seen: pass
    def ended(_):
        signal.raise_signal({0})
        time.sleep(0)
    watched = weakref.ref(seen := Seen(), ended)
    del seen
    time.sleep(30)""",
}


@pytest.mark.parametrize("lost", LOST)
@both_signals
def test_a_signal_of_which_a_library_makes_something_else_is_one_line(lost, number, how):
    """As TensorFlow does, where an interrupt meets the exception that it is about to raise."""
    said = f"dsnet: {how}; run the same command to go on\n"
    assert ended(LOST[lost].format(int(number))) == (128 + number, said)


def test_what_nobody_can_raise_is_told_as_ever():
    code = """
    class Ends:
        def __del__(self): raise ValueError("told")
    Ends()
assert sys.unraisablehook is sys.__unraisablehook__"""
    status, said = ended(code)
    assert (status, said.count("ValueError: told")) == (0, 1), said


def test_signals_are_answered_as_before_afterwards():
    code = """
    pass
assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
assert signal.getsignal(signal.SIGINT) is signal.default_int_handler"""
    assert ended(code) == (0, "")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_after_all_is_done_changes_nothing(number):
    code = f"import atexit; atexit.register(signal.raise_signal, {int(number)})"
    assert ended(code) == (0, "")


def test_who_has_interrupted_may_do_so_again_while_threads_end():
    """The interpreter waits for them before it ends what `atexit` has."""
    code = """
    import threading
    def again():
        main = threading.main_thread()
        while main.is_alive():
            time.sleep(0.01)
        os.kill(os.getpid(), signal.SIGINT)
        time.sleep(0.2)
    threading.Thread(target=again).start()
    signal.raise_signal(signal.SIGINT)
    time.sleep(60)"""
    assert ended(code) == (130, "dsnet: interrupted; run the same command to go on\n")


def test_an_interrupt_of_all_is_answered_by_the_first_alone(tmp_path: Path):
    """The child is loading its libraries: there it could say nothing but a traceback."""
    (tmp_path / "waits.py").write_text(WAITS)
    code = f"""
import sys
sys.path.insert(0, {str(Path.cwd())!r})
from bridge.processes import exit_with_one_line
from benchmarks.processes import run_module
with exit_with_one_line():
    run_module("waits", "begun")
"""
    process = subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}"},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    while not (tmp_path / "begun").exists():
        assert process.poll() is None
    for _ in range(3):
        os.killpg(process.pid, signal.SIGINT)
    said = process.communicate(timeout=60)[1]
    assert (process.returncode, said.count("\n")) == (130, 1), said


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="Linux's")
def test_a_batch_job_uses_the_cores_that_it_was_given() -> None:
    code = (
        "import os; from bridge.processes import usable_cores; "
        "os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:1]); print(usable_cores())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "1"


@pytest.mark.parametrize(
    ("quota", "cores"),
    [("200000 100000", 2), ("150000 100000", 2), ("1000 100000", 1), ("max 100000", 8), ("", 8)],
)
def test_a_container_uses_the_cores_that_it_was_given(
    quota: str, cores: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cpu.max").write_text(quota)
    monkeypatch.setattr(processes, "_QUOTA", tmp_path / "cpu.max")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(8)), raising=False)
    assert usable_cores() == cores
