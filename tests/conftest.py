"""Settings of the whole test suite."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings
from joblib import cpu_count

from narx_sklearn._threads import single_threaded_blas

# Derandomised, so that a run fails for a change and not for a draw; compiled kernels need no deadline.
# To look for new counterexamples: python -m pytest --hypothesis-profile=explore
settings.register_profile("law", deadline=None, derandomize=True, max_examples=40)
settings.register_profile("explore", deadline=None, max_examples=2000)
settings.load_profile("law")


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    """Spread a run of the whole suite over the cores where pytest-xdist is there; `-n 0` does not."""
    is_whole = config.args_source is pytest.Config.ArgsSource.TESTPATHS
    is_worker = hasattr(config, "workerinput")
    can_spread = config.pluginmanager.hasplugin("xdist") and not is_worker
    if is_whole and can_spread and config.option.numprocesses is None:
        config.option.numprocesses, config.option.dist = cpu_count(), "loadfile"
        # xdist would begin with the files of most tests, and keep whole diagnoses, long and few, for the end,
        # when other workers have nothing left; as collected, doctests come last, in many small files
        config.option.loadscopereorder = False
        os.environ.setdefault("OMP_NUM_THREADS", "1")  # of each worker: together they have all cores already


def pytest_sessionstart(session):
    """Compile what takes longest side by side, before workers begin together and each compiles all of it."""
    if session.config.pluginmanager.hasplugin("dsession"):
        compile_ahead("simulator", "compensator")


def compile_ahead(*names):
    """Run parts of a script at the same time."""
    script = Path(__file__).with_name("compiled_ahead.py")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    running = [subprocess.Popen([sys.executable, script, name], env=environment) for name in names]
    for process in running:
        process.wait()


@pytest.fixture(scope="session", autouse=True)
def small_matrices_need_one_thread():
    """Call parts as the estimators call them: with threads of its own BLAS doubles the time."""
    with single_threaded_blas():
        yield
