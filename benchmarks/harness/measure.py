"""Run one job in a fresh process with its own threads, time limit, memory limit and peak memory (Linux)."""

import importlib
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parents[1]
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def run_fresh(
    target: str, task: dict[str, Any], *, threads: int, limit_s: float, memory_gb: float
) -> dict[str, Any]:
    """Call `module:function` with `task` in a new interpreter and return the dict it returns.

    `peak_mb` (highest resident memory of that process) is added. A job that does not come back with an answer
    gives `{"failed": reason}`: time limit (processor seconds a thread), memory limit, or the last
    line of its error. Wall time is bounded too, loosely, for a job that waits for ever.
    """
    environment = os.environ | dict.fromkeys(THREAD_VARIABLES, str(threads))
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        limits = [str(limit_s * threads), str(memory_gb)]
        command = [sys.executable, "-m", "harness.measure", target, str(answer), *limits]
        try:
            done = subprocess.run(
                command,
                input=json.dumps(task),
                cwd=HERE,
                env=environment,
                timeout=20 * limit_s,
                capture_output=True,
                text=True,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return {"failed": f"wall time > {20 * limit_s:g} s"}
        if answer.exists():
            return json.loads(answer.read_text())
    if done.returncode == -signal.SIGXCPU:
        return {"failed": f"time > {limit_s:g} s"}
    if done.returncode < 0:
        return {"failed": f"killed by signal {-done.returncode} (memory {memory_gb:g} GB?)"}
    last_line = (done.stderr.strip().splitlines() or ["no message"])[-1]
    if "MemoryError" in last_line or "Unable to allocate" in last_line:
        return {"failed": f"memory > {memory_gb:g} GB"}
    return {"failed": last_line[:200]}


def reset_peak_memory() -> None:
    """Forget the peak so far, so that what follows is measured from what is held now (Linux)."""
    Path("/proc/self/clear_refs").write_text("5")


def peak_memory_mb() -> float:
    """Return the highest resident memory of this process.

    `ru_maxrss` is not used: a process started from a large one inherits its figure.
    """
    status = Path("/proc/self/status").read_text()
    kilobytes = next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM"))
    return int(kilobytes) / 1024


def _main() -> None:
    target, answer, limit_s, memory_gb = sys.argv[1:5]
    processor_s, address_space = int(float(limit_s)), int(float(memory_gb) * 2**30)
    resource.setrlimit(resource.RLIMIT_CPU, (processor_s, processor_s + 5))
    resource.setrlimit(resource.RLIMIT_AS, (address_space, address_space))
    module, _, name = target.partition(":")
    result = getattr(importlib.import_module(module), name)(json.load(sys.stdin))
    result.setdefault("peak_mb", peak_memory_mb())
    Path(answer).write_text(json.dumps(result))


if __name__ == "__main__":
    _main()
