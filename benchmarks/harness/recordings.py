"""The official training and test parts of the recordings, and how a search may use the training part."""

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd


@dataclass(frozen=True)
class Test:
    """A test record; its first `n_state` outputs set the state and are not scored."""

    u: np.ndarray
    y: np.ndarray
    n_state: int


@dataclass(frozen=True)
class SearchSpec:
    """What a method is told besides the training record.

    `fit` and `validation` are the parts of the training record to search on, `final` the part on which the
    choice is fitted. No model may need more than `n_state` past samples. `max_cells` bounds samples times
    candidates of one regressor matrix, so that a method without a compressed form ends in time.
    """

    fit: slice
    validation: slice
    final: slice
    n_state: int
    lags: tuple[int, ...]
    degrees: tuple[int, ...]
    sizes: tuple[int, ...]
    decimations: tuple[int, ...] = (1,)
    budget_s: float = 150.0
    max_cells: float = 4e7


@dataclass(frozen=True)
class Recording:
    """One row family of the table."""

    u: np.ndarray
    y: np.ndarray
    tests: dict[str, Test]
    spec: SearchSpec
    unit: str
    per_unit: float  # of the recorded unit: 1000 turns V into mV
    references: dict[str, str] = field(default_factory=dict)


SIZES = (4, 6, 8, 10, 13, 16, 20, 25, 30)


def data_folder() -> Path:
    """Return the folder of the recordings: NARX_SKLEARN_DATA, or ../shared/data beside the checkout."""
    default = Path(__file__).resolve().parents[3] / "shared" / "data"
    folder = Path(os.environ.get("NARX_SKLEARN_DATA", default))
    if not folder.is_dir():
        raise FileNotFoundError(
            f"The recordings are not in {folder}. Set NARX_SKLEARN_DATA to the folder that holds "
            "silverbox/, emps/, cascaded_tanks/, wiener_hammerstein/, bouc_wen/ and f16_gvt/."
        )
    return folder


def _columns(name: str, part: str, u: str, y: str) -> tuple[np.ndarray, np.ndarray]:
    table = pd.read_csv(data_folder() / name / f"{name}_{part}.csv.gz")
    table.columns = [column.split(" [")[0] for column in table.columns]
    return table[u].to_numpy(float), table[y].to_numpy(float)


def _silverbox() -> Recording:
    u, y = _columns("silverbox", "snls80mv", "V1", "V2")
    train, multisine = slice(40650, 40650 + 65062), slice(40650 + 65062, 127400)
    arrow, inner = slice(100, 40575), slice(100, 32100)
    return Recording(
        u[train],
        y[train],
        {
            "multisine": Test(u[multisine], y[multisine], 50),
            "arrow": Test(u[arrow], y[arrow], 50),
            "arrow, no extrapolation": Test(u[inner], y[inner], 50),
        },
        SearchSpec(
            slice(0, 16000), slice(16000, 22000), slice(0, 65062), 50, (1, 2, 3, 4, 5), (1, 2, 3), SIZES
        ),
        "mV",
        1e3,
        {
            "multisine": "SUBNET 0.36",
            "arrow": "SUBNET 1.4, PNLSS 0.26",
            "arrow, no extrapolation": "SUBNET 0.32",
        },
    )


def _emps() -> Recording:
    u, y = _columns("emps", "estimation", "vir", "qm")
    test = _columns("emps", "test_pulses", "vir", "qm")
    return Recording(
        u,
        y,
        {"pulses": Test(*test, 20)},
        SearchSpec(
            slice(0, 16000),
            slice(16000, 24841),
            slice(0, 24841),
            20,
            (2, 3, 4),
            (1, 2, 3),
            SIZES,
            decimations=(5, 1),
        ),
        "mm",
        1e3,
        {"pulses": "dynoNet 2.64, SUBNET 4.61"},
    )


def _tanks() -> Recording:
    u, y = _columns("cascaded_tanks", "estimation", "u", "y")
    test = _columns("cascaded_tanks", "test", "u", "y")
    return Recording(
        u,
        y,
        {"test": Test(*test, 50)},
        SearchSpec(
            slice(0, 700), slice(700, 1024), slice(0, 1024), 50, (1, 2, 3, 4, 5, 6, 8), (1, 2, 3), SIZES
        ),
        "V",
        1.0,
        {"test": "NLSS2 0.34, grey box 0.18"},
    )


def _wiener_hammerstein() -> Recording:
    u, y = _columns("wiener_hammerstein", "full", "u", "y")
    kept = slice(5200, 184000)
    u, y = u[kept], y[kept]
    return Recording(
        u[:100000],
        y[:100000],
        {"test": Test(u[100000:], y[100000:], 50)},
        SearchSpec(
            slice(0, 16000),
            slice(16000, 22000),
            slice(0, 100000),
            50,
            (3, 5, 6, 8, 10),
            (1, 2, 3),
            (*SIZES, 40),
        ),
        "mV",
        1e3,
        {"test": "SUBNET 0.241, PNLSS 0.42"},
    )


def _bouc_wen() -> Recording:
    u, y = _columns("bouc_wen", "train_multisine", "u", "y")
    multisine = _columns("bouc_wen", "test_multisine", "u", "y")
    sweep = _columns("bouc_wen", "test_sinesweep", "u", "y")
    return Recording(
        u,
        y,
        {"multisine": Test(*multisine, 50), "sweep": Test(*sweep, 50)},
        # Five periods of one multisine: search inside the second period, so that the judge is unseen data.
        SearchSpec(
            slice(8192, 14000),
            slice(14000, 16384),
            slice(8192, 40960),
            50,
            (2, 3, 4, 5, 6, 8),
            (1, 2, 3),
            SIZES,
        ),
        "1e-5 m",
        1e5,
        {"multisine": "PNLSS 1.87, dynoNet 4.52"},
    )


def _f16(level: int, output: str) -> Callable[[], Recording]:
    def load() -> Recording:
        column = {"shaker": "Acc1_shaker", "wing": "Acc2_wing", "payload": "Acc3_payload"}[output]
        u, y = _columns("f16_gvt", f"fullmsine_level{level + 1}_est", "Force", column)
        test = _columns("f16_gvt", f"fullmsine_level{level}_test", "Force", column)
        return Recording(
            u,
            y,
            {"test": Test(*test, 50)},
            # Nine periods of one multisine, the first a transient: search inside the second period.
            SearchSpec(
                slice(8192, 14000),
                slice(14000, 16384),
                slice(8192, 32768),
                50,
                (4, 6, 8, 10),
                (1, 2, 3),
                (*SIZES, 40),
                decimations=(4, 1),
            ),
            "m/s^2?",
            1.0,
        )

    return load


RECORDINGS: dict[str, Callable[[], Recording]] = {
    "silverbox": _silverbox,
    "emps": _emps,
    "tanks": _tanks,
    "wiener_hammerstein": _wiener_hammerstein,
    "bouc_wen": _bouc_wen,
} | {
    f"f16_level{level}_{output}": _f16(level, output)
    for level in (2, 4, 6)
    for output in ("wing", "payload", "shaker")
}
