"""Fetchers of the benchmarks of nonlinear system identification, in their official splits."""

from types import MappingProxyType

from narx_sklearn.datasets import _descriptions as descriptions
from narx_sklearn.datasets._files import PathLike, check_choice, rows
from narx_sklearn.datasets._registry import load, sources
from narx_sklearn.datasets._results import Benchmark

__all__ = [
    "fetch_bouc_wen",
    "fetch_cascaded_tanks",
    "fetch_emps",
    "fetch_f16",
    "fetch_silverbox",
    "fetch_wiener_hammerstein",
]

# Samples that set the state where a document names no number: that of the official loader.
N_INIT = 50
F16_PARTS = MappingProxyType(
    {
        "multisine": (
            {f"level {k}": f"fullmsine_level{k}_est" for k in (1, 3, 5, 7)},
            {f"level {k}": f"fullmsine_level{k}_test" for k in (2, 4, 6)},
        ),
        "sine sweep": (
            {f"level {k}": f"sinesw_level{k}_est" for k in (1, 3)},
            {"level 2": "sinesw_level2_test"},
        ),
    }
)

_BASELINES = (
    "M. Champneys, G. Beintema, R. Toth, M. Schoukens, T. Rogers, "
    '"Baseline Results for Selected Nonlinear System Identification Benchmarks", arXiv:2405.10779 '
    "(published errors)."
)


def fetch_silverbox(*, data_home: PathLike = None) -> Benchmark:
    """Fetch the Silverbox: an electronic circuit that behaves like a hardening spring.

    The circuit realises ``m y'' + d y' + (a + b y^2) y = u``. It is the least noisy and most used
    benchmark of the field; the arrow test reaches larger amplitudes than the training part.

    Parameters
    ----------
    data_home : path-like or None, default=None
        Folder for downloads; None is the cache folder of the operating system. Ignored where the
        environment variable NARX_SKLEARN_DATA names a folder of local copies.

    Returns
    -------
    data : Benchmark
        Train (65,062 samples); test ``"multisine"`` (21,688), ``"arrow"`` (40,475) and
        ``"arrow_no_extrapolation"`` (its first 32,000). Input and output in V, period 1/610.35 s.

    Raises
    ------
    FileNotFoundError
        If NARX_SKLEARN_DATA is set and the file is not there.
    ImportError
        If pooch is needed and not installed.
    ConnectionError
        If the file cannot be downloaded.
    ValueError
        If the content is not the known one.

    Notes
    -----
    Split and number of initial samples are those of the loader nonlinear_benchmarks 1.0.1.

    References
    ----------
    .. [1] T. Wigren, J. Schoukens, "Three free data sets for development and benchmarking in nonlinear
       system identification", European Control Conference, 2013, eqs. (13)-(14).

    Examples
    --------
    >>> from narx_sklearn.datasets import fetch_silverbox
    >>> data = fetch_silverbox()  # doctest: +SKIP
    >>> len(data.train)  # doctest: +SKIP
    65062
    """
    frame = load("silverbox", "snls80mv", data_home)
    return Benchmark(
        name="silverbox",
        train=rows(frame, 40_650, 105_712),
        test={
            "multisine": rows(frame, 105_712, 127_400),
            "arrow": rows(frame, 100, 40_575),
            "arrow_no_extrapolation": rows(frame, 100, 32_100),
        },
        input=["V1 [V]"],
        output="V2 [V]",
        sampling_period=2**14 / 1e7,
        n_init=N_INIT,
        licence="Data: not stated. Copy: MIT.",
        source=sources("silverbox", "snls80mv"),
        DESCR=descriptions.SILVERBOX,
        references=(
            'T. Wigren, J. Schoukens, "Three free data sets for development and benchmarking in nonlinear '
            'system identification", ECC 2013.',
            _BASELINES,
        ),
    )


def fetch_emps(*, data_home: PathLike = None) -> Benchmark:
    """Fetch EMPS: a linear drive with friction, recorded under position control.

    ``gtau vir = M q'' + Fv q' + Fc sign(q') + offset``, with a friction that differs between the two
    directions. The plant integrates, and the record is closed-loop.

    Parameters
    ----------
    data_home : path-like or None, default=None
        Folder for downloads; None is the cache folder of the operating system. Ignored where the
        environment variable NARX_SKLEARN_DATA names a folder of local copies.

    Returns
    -------
    data : Benchmark
        Train and test of 24,841 samples each: drive voltage ``vir [V]`` (input), position ``qm [m]``
        (output), reference ``qg [m]``, time, and in the test part the force pulses, in V, that
        ``vir [V]`` already contains. Period 1 ms.

    Raises
    ------
    FileNotFoundError
        If NARX_SKLEARN_DATA is set and the file is not there.
    ImportError
        If pooch is needed and not installed.
    ConnectionError
        If the file cannot be downloaded.
    ValueError
        If the content is not the known one.

    References
    ----------
    .. [1] A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", Workshop on Nonlinear
       System Identification Benchmarks, 2019.

    Examples
    --------
    >>> from narx_sklearn.datasets import fetch_emps
    >>> data = fetch_emps()  # doctest: +SKIP
    >>> data.n_init  # doctest: +SKIP
    20
    """
    return Benchmark(
        name="emps",
        train=load("emps", "estimation", data_home),
        test=load("emps", "test_pulses", data_home),
        input=["vir [V]"],
        output="qm [m]",
        sampling_period=1e-3,
        n_init=20,
        licence="Data: not stated. Copy: Apache-2.0.",
        source=sources("emps", "estimation", "test_pulses"),
        DESCR=descriptions.EMPS,
        references=(
            'A. Janot, M. Gautier, M. Brunot, "Data Set and Reference Models of EMPS", 2019.',
            _BASELINES,
        ),
        constants={"gtau [N/V]": 35.15065188248547, "kp [1/s]": 160.18, "kv [V s/m]": 243.45},
    )


def fetch_cascaded_tanks(*, data_home: PathLike = None) -> Benchmark:
    """Fetch the cascaded tanks: two tanks with free outlets, a pump, and overflow.

    ``x1' = -k1 sqrt(x1) + k4 u, x2' = k2 sqrt(x1) - k3 sqrt(x2), y = x2``, until the upper tank runs over,
    partly into the lower one. Short records with a hard nonlinearity and an unknown initial state.

    Parameters
    ----------
    data_home : path-like or None, default=None
        Folder for downloads; None is the cache folder of the operating system. Ignored where the
        environment variable NARX_SKLEARN_DATA names a folder of local copies.

    Returns
    -------
    data : Benchmark
        Train and test of 1,024 samples each; pump voltage ``u [V]``, level of the lower tank ``y [V]``.
        Period 4 s.

    Raises
    ------
    FileNotFoundError
        If NARX_SKLEARN_DATA is set and the file is not there.
    ImportError
        If pooch is needed and not installed.
    ConnectionError
        If the file cannot be downloaded.
    ValueError
        If the content is not the known one.

    References
    ----------
    .. [1] M. Schoukens, P. Mattsson, T. Wigren, J.P. Noel, "Cascaded tanks benchmark combining soft and hard
       nonlinearities", Workshop on Nonlinear System Identification Benchmarks, 2016.

    Examples
    --------
    >>> from narx_sklearn.datasets import fetch_cascaded_tanks
    >>> data = fetch_cascaded_tanks()  # doctest: +SKIP
    >>> data.sampling_period  # doctest: +SKIP
    4.0
    """
    return Benchmark(
        name="cascaded_tanks",
        train=load("cascaded_tanks", "estimation", data_home),
        test=load("cascaded_tanks", "test", data_home),
        input=["u [V]"],
        output="y [V]",
        sampling_period=4.0,
        n_init=N_INIT,
        licence="Data: not stated. Copy: Apache-2.0.",
        source=sources("cascaded_tanks", "estimation", "test"),
        DESCR=descriptions.CASCADED_TANKS,
        references=(
            'M. Schoukens, P. Mattsson, T. Wigren, J.P. Noel, "Cascaded tanks benchmark combining soft and '
            'hard nonlinearities", 2016.',
            _BASELINES,
        ),
    )


def fetch_wiener_hammerstein(*, data_home: PathLike = None) -> Benchmark:
    """Fetch the Wiener-Hammerstein circuit: a diode saturation between two filters.

    Third-order Chebyshev low-pass (4.4 kHz), one-sided saturation by a diode and resistors, third-order
    inverse Chebyshev low-pass (5 kHz) with a transmission zero in the band.

    Parameters
    ----------
    data_home : path-like or None, default=None
        Folder for downloads; None is the cache folder of the operating system. Ignored where the
        environment variable NARX_SKLEARN_DATA names a folder of local copies.

    Returns
    -------
    data : Benchmark
        Train (100,000 samples) and test (78,800); input and output in V, period 1/51,200 s.

    Raises
    ------
    FileNotFoundError
        If NARX_SKLEARN_DATA is set and the file is not there.
    ImportError
        If pooch is needed and not installed.
    ConnectionError
        If the file cannot be downloaded.
    ValueError
        If the content is not the known one.

    Notes
    -----
    Split as in the loader nonlinear_benchmarks 1.0.1, samples 5,200 to 184,000. The paper of 2009 takes
    samples 1 to 100,000 and 100,001 to 188,000.

    References
    ----------
    .. [1] J. Schoukens, J. Suykens, L. Ljung, "Wiener-Hammerstein benchmark", IFAC SYSID, 2009.

    Examples
    --------
    >>> from narx_sklearn.datasets import fetch_wiener_hammerstein
    >>> data = fetch_wiener_hammerstein()  # doctest: +SKIP
    >>> len(data.test)  # doctest: +SKIP
    78800
    """
    frame = load("wiener_hammerstein", "full", data_home)
    return Benchmark(
        name="wiener_hammerstein",
        train=rows(frame, 5_200, 105_200),
        test=rows(frame, 105_200, 184_000),
        input=["u [V]"],
        output="y [V]",
        sampling_period=1 / 51_200,
        n_init=N_INIT,
        licence="Data: not stated. Copy: BSD-3-Clause.",
        source=sources("wiener_hammerstein", "full"),
        DESCR=descriptions.WIENER_HAMMERSTEIN,
        references=(
            'J. Schoukens, J. Suykens, L. Ljung, "Wiener-Hammerstein benchmark", IFAC SYSID, 2009.',
            _BASELINES,
        ),
    )


def fetch_bouc_wen(*, data_home: PathLike = None) -> Benchmark:
    """Fetch the Bouc-Wen benchmark: a simulated oscillator with hysteresis.

    ``mL y'' + cL y' + kL y + z = u``, ``z' = alpha y' - beta (gamma |y'| |z|^(nu-1) z + delta y' |z|^nu)``;
    z is hidden. All parameters are known and are in ``constants``.

    Parameters
    ----------
    data_home : path-like or None, default=None
        Folder for downloads; None is the cache folder of the operating system. Ignored where the
        environment variable NARX_SKLEARN_DATA names a folder of local copies.

    Returns
    -------
    data : Benchmark
        Train (40,960 samples, noisy); test ``"multisine"`` (8,192) and ``"sine sweep"`` (153,000), without
        noise. Force ``u [N]``, displacement ``y [m]``, period 1/750 s.

    Raises
    ------
    FileNotFoundError
        If NARX_SKLEARN_DATA is set and the file is not there.
    ImportError
        If pooch or h5py is needed and not installed.
    ConnectionError
        If a file cannot be downloaded.
    ValueError
        If the content is not the known one.

    Notes
    -----
    The benchmark ships a simulator instead of training data. The training part was made with it by the
    authors of the cited repository: five periods of 8192 samples, 50 N RMS, 5 to 150 Hz. The document names
    no number of initial samples; `n_init` is that of the related benchmarks.

    References
    ----------
    .. [1] J.P. Noel, M. Schoukens, "Hysteretic benchmark with a dynamic nonlinearity", Workshop on Nonlinear
       System Identification Benchmarks, 2016.

    Examples
    --------
    >>> from narx_sklearn.datasets import fetch_bouc_wen
    >>> data = fetch_bouc_wen()  # doctest: +SKIP
    >>> data.constants["mL [kg]"]  # doctest: +SKIP
    2.0
    """
    return Benchmark(
        name="bouc_wen",
        train=load("bouc_wen", "train_multisine", data_home),
        test={
            "multisine": load("bouc_wen", "test_multisine", data_home),
            "sine sweep": load("bouc_wen", "test_sinesweep", data_home),
        },
        input=["u [N]"],
        output="y [m]",
        sampling_period=1 / 750,
        n_init=N_INIT,
        licence="Data: not stated. Copy: MIT.",
        source=sources("bouc_wen", "train_multisine", "test_multisine", "test_sinesweep"),
        DESCR=descriptions.BOUC_WEN,
        references=(
            'J.P. Noel, M. Schoukens, "Hysteretic benchmark with a dynamic nonlinearity", 2016.',
            'M. Forgione, D. Piga, "dynoNet: a neural network architecture for learning dynamical systems", '
            "2021.",
        ),
        constants={
            "mL [kg]": 2.0,
            "cL [N s/m]": 10.0,
            "kL [N/m]": 5e4,
            "alpha [N/m]": 5e4,
            "beta [1/m]": 1e3,
            "gamma [-]": 0.8,
            "delta [-]": -1.1,
            "nu [-]": 1.0,
        },
    )


def fetch_f16(excitation: str = "multisine", *, data_home: PathLike = None) -> Benchmark:
    """Fetch the F-16 ground vibration test: an aircraft with clearance and friction at a wing mounting.

    About ten modes between 2 and 15 Hz; the sliding rail between wing and payload opens and rubs, which
    bends the wing-torsion mode near 7.3 Hz.

    Parameters
    ----------
    excitation : {"multisine", "sine sweep"}, default="multisine"
        Full random multisine (2 to 15 Hz, nine periods of 8192 samples, the first transient) or sweep
        (15 to 2 Hz at 0.05 Hz/s).
    data_home : path-like or None, default=None
        Folder for downloads; None is the cache folder of the operating system. Ignored where the
        environment variable NARX_SKLEARN_DATA names a folder of local copies.

    Returns
    -------
    data : Benchmark
        Mappings by excitation level: multisine, train levels 1, 3, 5, 7 and test levels 2, 4, 6 (73,728
        samples each); sweep, train levels 1, 3 and test level 2 (108,477). Input ``Force [N]``, three
        accelerations as outputs, period 1/400 s.

    Raises
    ------
    FileNotFoundError
        If NARX_SKLEARN_DATA is set and a file is not there.
    ImportError
        If pooch is needed and not installed.
    ConnectionError
        If a file cannot be downloaded.
    ValueError
        If `excitation` is unknown, or the content is not the known one.

    Notes
    -----
    Level 2 tests for level 3, 4 for 5, 6 for 7. Sweeps above level 3 and the special odd multisines are not
    offered. The document names no number of initial samples; `n_init` is that of the related benchmarks.

    References
    ----------
    .. [1] J.P. Noel, M. Schoukens, "F-16 aircraft benchmark based on ground vibration test data", Workshop on
       Nonlinear System Identification Benchmarks, 2017.

    Examples
    --------
    >>> from narx_sklearn.datasets import fetch_f16
    >>> data = fetch_f16()  # doctest: +SKIP
    >>> len(data.train_parts)  # doctest: +SKIP
    4
    """
    check_choice("excitation", excitation, F16_PARTS)
    train, test = F16_PARTS[excitation]
    return Benchmark(
        name="f16",
        train={level: load("f16_gvt", part, data_home) for level, part in train.items()},
        test={level: load("f16_gvt", part, data_home) for level, part in test.items()},
        input=["Force [N]"],
        output=["Acc1_shaker [m/s^2?]", "Acc2_wing [m/s^2?]", "Acc3_payload [m/s^2?]"],
        sampling_period=1 / 400,
        n_init=N_INIT,
        licence="Data: not stated. Copy: MIT.",
        source=sources("f16_gvt", *train.values(), *test.values()),
        DESCR=descriptions.F16,
        references=(
            'J.P. Noel, M. Schoukens, "F-16 aircraft benchmark based on ground vibration test data", 2017.',
        ),
    )
