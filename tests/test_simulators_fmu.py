"""An FMU built here from a few lines of C, and its simulator."""

import pickle
import platform
import shutil
import subprocess
import sys
import zipfile

import numpy as np
import pytest
from scipy.signal import lfilter

from narx_sklearn.discrepancy.surrogates.fmu import FMUSimulator

# level' = gain * pump - outflow * level, stepped exactly for a pump held between samples (FMI 2.0)
SOURCE = r"""
#include <math.h>
#include <stdlib.h>
typedef double real; typedef unsigned ref; typedef int status; typedef void* part;
enum { PUMP, GAIN, OUTFLOW, LEVEL, SIZE };
const char* fmi2GetTypesPlatform(void) { return "default"; }
const char* fmi2GetVersion(void) { return "2.0"; }
part fmi2Instantiate(const char* a, int b, const char* c, const char* d, const void* e, int f, int g) {
    real* v = calloc(SIZE, sizeof(real)); v[GAIN] = 1.0; v[OUTFLOW] = 0.5; return v; }
void fmi2FreeInstance(part p) { free(p); }
status fmi2SetReal(part p, const ref r[], size_t n, const real x[]) {
    for (size_t i = 0; i < n; i++) ((real*)p)[r[i]] = x[i]; return 0; }
status fmi2GetReal(part p, const ref r[], size_t n, real x[]) {
    for (size_t i = 0; i < n; i++) x[i] = ((real*)p)[r[i]]; return 0; }
status fmi2DoStep(part p, real t, real h, int b) {
    real* v = p; real decay = exp(-v[OUTFLOW] * h), rest = v[GAIN] * v[PUMP] / v[OUTFLOW];
    v[LEVEL] = rest + decay * (v[LEVEL] - rest); return 0; }
#define NOTHING(name) status name(part p) { return 0; }
NOTHING(fmi2SetDebugLogging) NOTHING(fmi2SetupExperiment) NOTHING(fmi2EnterInitializationMode)
NOTHING(fmi2ExitInitializationMode) NOTHING(fmi2Terminate) NOTHING(fmi2Reset) NOTHING(fmi2GetInteger)
NOTHING(fmi2GetBoolean) NOTHING(fmi2GetString) NOTHING(fmi2SetInteger) NOTHING(fmi2SetBoolean)
NOTHING(fmi2SetString) NOTHING(fmi2GetFMUstate) NOTHING(fmi2SetFMUstate) NOTHING(fmi2FreeFMUstate)
NOTHING(fmi2SerializedFMUstateSize) NOTHING(fmi2SerializeFMUstate) NOTHING(fmi2DeSerializeFMUstate)
NOTHING(fmi2GetDirectionalDerivative) NOTHING(fmi2SetRealInputDerivatives)
NOTHING(fmi2GetRealOutputDerivatives) NOTHING(fmi2CancelStep) NOTHING(fmi2GetStatus)
NOTHING(fmi2GetRealStatus) NOTHING(fmi2GetIntegerStatus) NOTHING(fmi2GetBooleanStatus)
NOTHING(fmi2GetStringStatus)
"""
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="tank" guid="tank" numberOfEventIndicators="0">
<CoSimulation modelIdentifier="tank" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions><Unit name="m"/><Unit name="V"/></UnitDefinitions>
<ModelVariables>
<ScalarVariable name="pump" valueReference="0" causality="input" variability="continuous">
<Real unit="V" start="0"/></ScalarVariable>
<ScalarVariable name="gain" valueReference="1" causality="parameter" variability="tunable">
<Real start="1"/></ScalarVariable>
<ScalarVariable name="outflow" valueReference="2" causality="parameter" variability="tunable">
<Real start="0.5"/></ScalarVariable>
<ScalarVariable name="level" valueReference="3" causality="output" variability="continuous" initial="exact">
<Real unit="m" start="0"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="4"/></Outputs></ModelStructure>
</fmiModelDescription>
"""


@pytest.fixture(scope="module")
def unit(tmp_path_factory):
    pytest.importorskip("fmpy")
    if shutil.which("gcc") is None or platform.system() != "Linux":
        pytest.skip("building the unit needs gcc on Linux")
    folder = tmp_path_factory.mktemp("unit")
    (folder / "tank.c").write_text(SOURCE)
    subprocess.run(
        ["gcc", "-shared", "-fPIC", "-O1", "-o", folder / "tank.so", folder / "tank.c", "-lm"], check=True
    )
    with zipfile.ZipFile(folder / "tank.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION)
        archive.write(folder / "tank.so", "binaries/linux64/tank.so")
    return folder / "tank.fmu"


def exact(u, gain, outflow, dt):
    pole = np.exp(-outflow * dt)
    return lfilter([0, gain / outflow * (1 - pole)], [1, -pole], u)


def test_unit_gives_signals_units_and_parameters(unit):
    sim = FMUSimulator(unit, dt=0.1)
    assert [str(s) for s in sim.inputs + sim.outputs] == ["pump [V]", "level [m]"]
    assert {p.name: p.value for p in sim.parameters} == {"gain": 1.0, "outflow": 0.5}
    assert "tank.fmu" in repr(sim)


def test_unit_runs_as_its_equation_says(unit):
    u = np.random.default_rng(0).uniform(-1, 1, 60)
    sim = FMUSimulator(unit, dt=0.1, parameters={"gain": 2.0})
    np.testing.assert_allclose(sim.simulate(u)[:, 0], exact(u, 2.0, 0.5, 0.1), atol=1e-9)
    other = sim.with_parameters({"gain": 3.0})
    np.testing.assert_allclose(other.simulate(u)[:, 0], exact(u, 3.0, 0.5, 0.1), atol=1e-9)


def test_unit_gets_a_twin_and_survives_pickle(unit):
    u = np.random.default_rng(1).uniform(-1, 1, 150)
    sim = FMUSimulator(unit, dt=0.1).identified(u)
    assert sim.twin_error_ < 1e-6
    again = pickle.loads(pickle.dumps(sim))
    np.testing.assert_array_equal(again.simulate(u), sim.simulate(u))


def test_unit_refuses_unknown_variables(unit):
    with pytest.raises(ValueError, match=r"no real parameter \['mass'\]; it has \['gain', 'outflow'\]"):
        FMUSimulator(unit, dt=0.1, parameters=["mass"])
    with pytest.raises(TypeError, match="list of names"):
        FMUSimulator(unit, dt=0.1, parameters="gain")


def test_missing_file_and_missing_package_are_said(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="no file"):
        FMUSimulator(tmp_path / "none.fmu", dt=0.1)
    (tmp_path / "some.fmu").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "fmpy", None)
    with pytest.raises(ImportError, match=r'pip install "narx-sklearn\[fmu\]"'):
        FMUSimulator(tmp_path / "some.fmu", dt=0.1)
