"""Fetchers of recordings that have no official split."""

import numpy as np

from narx_sklearn.datasets import _descriptions as descriptions
from narx_sklearn.datasets._files import PathLike, check_choice, rows
from narx_sklearn.datasets._registry import load, sources
from narx_sklearn.datasets._results import Benchmark

__all__ = [
    "fetch_bh_loops",
    "fetch_buck_converter",
    "fetch_building_heating",
    "fetch_dc_motor_generator",
    "fetch_mr_damper",
]

# Samples that set the state, as in the official benchmarks.
N_INIT = 50
BH_MATERIALS = ("mnzn_ferrite", "mnzn_hp_ferrite", "amorphous_alloy", "m130_27s_steel")


def fetch_mr_damper(*, data_home: PathLike = None) -> Benchmark:
    """Fetch a magneto-rheological damper: force from displacement and driver voltage.

    Yield force that grows with the voltage, viscous drag, roll-off at low velocity, a lag of the driver.

    Parameters
    ----------
    data_home : path-like or None, default=None
        Folder for downloads; None is the cache folder of the operating system. Ignored where the
        environment variable NARX_SKLEARN_DATA names a folder of local copies.

    Returns
    -------
    data : Benchmark
        Train: first 70 % of the random-displacement record (51,847 samples); test ``"random"`` (22,221) and
        ``"ransim"`` (60,096). Inputs displacement ``D [cm]`` and voltage ``Y [V]``, output ``F [N]``; the
        velocity ``V [cm/s]``, derived from D, is in the frames. Period 1/3004.8 s.

    Raises
    ------
    FileNotFoundError
        If NARX_SKLEARN_DATA is set and a file is not there.
    ImportError
        If pooch is needed and not installed.
    ConnectionError
        If a file cannot be downloaded.
    ValueError
        If the content is not the known one.

    Notes
    -----
    There is no official split; this one is ours. The acceleration of the source is left out: its unit is not
    stated and fits no usual one.

    References
    ----------
    .. [1] S. Dyke, "Prototype MR Damper Characterization Tests Using White Noise", NEES-2012-1158,
       DOI 10.4231/D3V11VM6X.
    .. [2] B.F. Spencer, S.J. Dyke, M.K. Sain, J.D. Carlson, "Phenomenological model for magnetorheological
       dampers", J. Eng. Mech. 123(3), 1997.

    Examples
    --------
    >>> from narx_sklearn.datasets import fetch_mr_damper
    >>> data = fetch_mr_damper()  # doctest: +SKIP
    >>> len(data.train)  # doctest: +SKIP
    51847
    """
    random = load("mr_damper_nees", "ranran_50", data_home)
    n_train = 7 * len(random) // 10
    return Benchmark(
        name="mr_damper",
        train=rows(random, 0, n_train),
        test={
            "random": rows(random, n_train, len(random)),
            "ransim": load("mr_damper_nees", "ransim_u", data_home),
        },
        input=["D [cm]", "Y [V]"],
        output="F [N]",
        sampling_period=1 / 3004.8,
        n_init=N_INIT,
        licence="Data: terms of the DOI 10.4231/D3V11VM6X. Copy: says MIT without a licence file.",
        source=sources("mr_damper_nees", "ranran_50", "ransim_u"),
        DESCR=descriptions.MR_DAMPER,
        references=(
            'S. Dyke, "Prototype MR Damper Characterization Tests Using White Noise", NEES-2012-1158.',
            'B.F. Spencer et al., "Phenomenological model for magnetorheological dampers", J. Eng. Mech., '
            "1997.",
        ),
    )


def fetch_bh_loops(material: str = "mnzn_ferrite", *, data_home: PathLike = None) -> Benchmark:
    """Fetch quasi-static magnetisation loops B(H) of one material.

    Closed loops from small to large amplitude: does a model of hysteresis fitted to some predict the others?

    Parameters
    ----------
    material : str, default="mnzn_ferrite"
        "mnzn_ferrite", "mnzn_hp_ferrite", "amorphous_alloy" or "m130_27s_steel": isotropic Mn-Zn
        ferrite, high-permeability Mn-Zn ferrite, amorphous alloy with perpendicular anisotropy (a single
        loop), electrical steel along the easy axis.
    data_home : path-like or None, default=None
        Folder for downloads; None is the cache folder of the operating system. Ignored where the
        environment variable NARX_SKLEARN_DATA names a folder of local copies.

    Returns
    -------
    data : Benchmark
        ``H [A/m]`` (input), ``B [T]`` (output), ``loop [-]``. Test is the loop of the largest field, train
        the others; for the amorphous alloy, descending half (train) and ascending half (test) of its loop.
        Points are in order but have no time: ``sampling_period`` is None.

    Raises
    ------
    FileNotFoundError
        If NARX_SKLEARN_DATA is set and the file is not there.
    ImportError
        If pooch is needed and not installed.
    ConnectionError
        If a file cannot be downloaded.
    ValueError
        If `material` is unknown, or the content is not the known one.

    Notes
    -----
    There is no official split; this one is ours, and the reverse (fit the largest, predict the inner) is as
    telling.

    References
    ----------
    .. [1] R. Szewczyk, JAmodel: an open-source implementation of the Jiles-Atherton model, with measured
       loops, https://github.com/romanszewczyk/JAmodel

    Examples
    --------
    >>> from narx_sklearn.datasets import fetch_bh_loops
    >>> data = fetch_bh_loops()  # doctest: +SKIP
    >>> len(data.test)  # doctest: +SKIP
    129
    """
    check_choice("material", material, BH_MATERIALS)
    frame = load("bh_loops", material, data_home)
    loop, H = frame["loop [-]"].to_numpy(), frame["H [A/m]"].to_numpy()
    largest = loop == loop[H.argmax()]
    if largest.all():
        largest = np.arange(H.size) > H.argmin()
    return Benchmark(
        name="bh_loops",
        train=frame[~largest].reset_index(drop=True),
        test=frame[largest].reset_index(drop=True),
        input=["H [A/m]"],
        output="B [T]",
        sampling_period=None,
        n_init=1,
        licence="MIT.",
        source=sources("bh_loops", material),
        DESCR=descriptions.BH_LOOPS,
        references=("R. Szewczyk, JAmodel, https://github.com/romanszewczyk/JAmodel",),
    )


def fetch_dc_motor_generator(*, data_home: PathLike = None) -> Benchmark:
    """Fetch two DC machines on one shaft: motor voltage to generator signal.

    Parameters
    ----------
    data_home : path-like or None, default=None
        Folder for downloads; None is the cache folder of the operating system. Ignored where the
        environment variable NARX_SKLEARN_DATA names a folder of local copies.

    Returns
    -------
    data : Benchmark
        Train: first 70 % (350,000 samples), test: the rest (150,000). Input ``u [V]``, a binary sequence of 0
        and 5 V that changes at multiples of 500 samples; output ``y [?]``, unit not stated. The sampling
        period is not stated: None. Published models use every 100th or 500th sample.

    Raises
    ------
    FileNotFoundError
        If NARX_SKLEARN_DATA is set and the file is not there.
    ImportError
        If pooch is needed and not installed.
    ConnectionError
        If a file cannot be downloaded.
    ValueError
        If the content is not the known one.

    Notes
    -----
    There is no official split; this one is ours.

    References
    ----------
    .. [1] W.R. Lacerda Junior, V.M. Almeida, S.A.M. Martins, "Identificacao de um motor/gerador CC por meio
       de modelos polinomiais autorregressivos e redes neurais artificiais", SBAI, 2017.

    Examples
    --------
    >>> from narx_sklearn.datasets import fetch_dc_motor_generator
    >>> data = fetch_dc_motor_generator()  # doctest: +SKIP
    >>> len(data.test)  # doctest: +SKIP
    150000
    """
    frame = load("dc_motor_generator", "full", data_home)
    return Benchmark(
        name="dc_motor_generator",
        train=rows(frame, 0, 350_000),
        test=rows(frame, 350_000, 500_000),
        input=["u [V]"],
        output="y [?]",
        sampling_period=None,
        n_init=N_INIT,
        licence="Copy: MIT.",
        source=sources("dc_motor_generator", "full"),
        DESCR=descriptions.DC_MOTOR_GENERATOR,
        references=(
            'W.R. Lacerda Junior, V.M. Almeida, S.A.M. Martins, "Identificacao de um motor/gerador CC por '
            'meio de modelos polinomiais autorregressivos e redes neurais artificiais", SBAI, 2017.',
        ),
    )


def fetch_buck_converter(*, data_home: PathLike = None) -> Benchmark:
    """Fetch a DC/DC buck converter with a known static gain.

    In steady state ``y = (4 - u) Vd / 3`` with ``Vd = 24 V``: prior knowledge for a grey-box model.

    Parameters
    ----------
    data_home : path-like or None, default=None
        Folder for downloads; None is the cache folder of the operating system. Ignored where the
        environment variable NARX_SKLEARN_DATA names a folder of local copies.

    Returns
    -------
    data : Benchmark
        Train (1,001 samples) and test (999); control voltage ``u [V]``, output ``y [V]`` in steps of 0.2 V,
        time ``t [s]``. Period 10 us.

    Raises
    ------
    FileNotFoundError
        If NARX_SKLEARN_DATA is set and a file is not there.
    ImportError
        If pooch is needed and not installed.
    ConnectionError
        If a file cannot be downloaded.
    ValueError
        If the content is not the known one.

    References
    ----------
    .. [1] L.A. Aguirre, P.F. Donoso-Garcia, R. Santos-Filho, "Use of a priori information in the
       identification of global nonlinear models - a case study using a buck converter", IEEE TCAS-I 47(7),
       2000 (the converter this looks like; the source names no paper).

    Examples
    --------
    >>> from narx_sklearn.datasets import fetch_buck_converter
    >>> data = fetch_buck_converter()  # doctest: +SKIP
    >>> data.constants["Vd [V]"]  # doctest: +SKIP
    24.0
    """
    return Benchmark(
        name="buck_converter",
        train=load("buck_converter", "estimation", data_home),
        test=load("buck_converter", "test", data_home),
        input=["u [V]"],
        output="y [V]",
        sampling_period=1e-5,
        n_init=N_INIT,
        licence="Copy: MIT.",
        source=sources("buck_converter", "estimation", "test"),
        DESCR=descriptions.BUCK_CONVERTER,
        references=(
            "L.A. Aguirre, P.F. Donoso-Garcia, R. Santos-Filho, IEEE TCAS-I 47(7), 2000 (presumably this "
            "one).",
        ),
        constants={"Vd [V]": 24.0},
    )


def fetch_building_heating(*, data_home: PathLike = None) -> Benchmark:
    """Fetch the heating of a building: indoor temperature from heating power and weather.

    A network of resistances and capacities, and things the record does not hold: sun, people, kitchen gas.

    Parameters
    ----------
    data_home : path-like or None, default=None
        Folder for downloads; None is the cache folder of the operating system. Ignored where the
        environment variable NARX_SKLEARN_DATA names a folder of local copies.

    Returns
    -------
    data : Benchmark
        Train: 28 days (672 samples), test: the last 5 days (120). Inputs heating power ``Ph [kW]`` and
        outside temperature ``Ta [degC]``, output inside temperature ``Ti [degC]``; the heating circuit's
        temperature ``Th [degC]`` is in the frames. Period 3600 s.

    Raises
    ------
    FileNotFoundError
        If NARX_SKLEARN_DATA is set and the file is not there.
    ImportError
        If pooch is needed and not installed.
    ConnectionError
        If a file cannot be downloaded.
    ValueError
        If the content is not the known one.

    References
    ----------
    .. [1] C. Zagoni, DarkGreyBox: grey-box modelling of buildings, https://github.com/czagoni/darkgreybox

    Examples
    --------
    >>> from narx_sklearn.datasets import fetch_building_heating
    >>> data = fetch_building_heating()  # doctest: +SKIP
    >>> len(data.test)  # doctest: +SKIP
    120
    """
    frame = load("building_heating", "full", data_home)
    return Benchmark(
        name="building_heating",
        train=rows(frame, 0, 672),
        test=rows(frame, 672, 792),
        input=["Ph [kW]", "Ta [degC]"],
        output="Ti [degC]",
        sampling_period=3600.0,
        n_init=24,
        licence="Copy: MIT by its licence file, GPL-3.0 by its badge.",
        source=sources("building_heating", "full"),
        DESCR=descriptions.BUILDING_HEATING,
        references=("C. Zagoni, DarkGreyBox, https://github.com/czagoni/darkgreybox",),
    )
