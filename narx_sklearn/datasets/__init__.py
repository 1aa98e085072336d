"""Public recordings in their official splits, and synthetic plants with ground truth.

``fetch_*`` read a local copy (folder in the environment variable NARX_SKLEARN_DATA) or download the original,
and check the numbers against a known checksum either way. It is the numbers that are checked, to the digits
of the copies the checksums were made from, because checksums of the original files are not known.
``make_*`` simulate plants that ship with the
package; they need no data.
"""

from narx_sklearn.datasets._fetch import (
    fetch_bouc_wen,
    fetch_cascaded_tanks,
    fetch_emps,
    fetch_f16,
    fetch_silverbox,
    fetch_wiener_hammerstein,
)
from narx_sklearn.datasets._fetch_other import (
    fetch_bh_loops,
    fetch_buck_converter,
    fetch_building_heating,
    fetch_dc_motor_generator,
    fetch_mr_damper,
)
from narx_sklearn.datasets._plants_hysteresis import (
    make_hysteresis_circuit,
    make_mr_damper,
    make_piezo_bench,
)
from narx_sklearn.datasets._plants_mechanical import (
    make_duffing,
    make_pneumatic_valve,
    make_servo_axis,
)
from narx_sklearn.datasets._plants_process import make_cascaded_tanks, make_ph_process
from narx_sklearn.datasets._random_narx import make_narx
from narx_sklearn.datasets._results import Benchmark, PlantTruth, SyntheticPlant

__all__ = [
    "Benchmark",
    "PlantTruth",
    "SyntheticPlant",
    "fetch_bh_loops",
    "fetch_bouc_wen",
    "fetch_buck_converter",
    "fetch_building_heating",
    "fetch_cascaded_tanks",
    "fetch_dc_motor_generator",
    "fetch_emps",
    "fetch_f16",
    "fetch_mr_damper",
    "fetch_silverbox",
    "fetch_wiener_hammerstein",
    "make_cascaded_tanks",
    "make_duffing",
    "make_hysteresis_circuit",
    "make_mr_damper",
    "make_narx",
    "make_ph_process",
    "make_piezo_bench",
    "make_pneumatic_valve",
    "make_servo_axis",
]
