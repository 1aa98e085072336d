"""What the public recordings hold: the text of ``DESCR``."""

SILVERBOX = """\
Electronic circuit close to a mass on a hardening spring, m y'' + d y' + (a + b y^2) y = u, with
very little noise. Train and multisine test: ten realisations of a random odd multisine. Arrow test:
filtered noise with an amplitude that rises from zero; it reaches |y| = 0.300 V where the multisine
reaches 0.231 V, so its tail extrapolates. Both channels have a small offset (0.006 V in the leading
zeros). Published free-run errors, mV (multisine / arrow / arrow without extrapolation): SUBNET 0.36
/ 1.4 / 0.32; PNLSS - / 0.26 / -.
"""

EMPS = """\
Drive with a screw, under PD control: vir = kp kv (qg - q) - kv dq + pulses, limited to +-10 V; dq
is the backward difference of the mean of two samples of q. The input vir is a voltage; force is
gtau vir. The pulses of the test part are 0 or 5 V and are part of vir already. With the reference
qg as input the loop is almost linear and says little about the drive. Fitted by the authors: M
95.1089 kg, Fv 203.5034 N s/m, Fc 20.3935 N, offset -3.1648 N; with asymmetric friction M 95.1540,
Fv+ 166.7061, Fc+ 20.1440, Fv- 240.4236, Fc- 20.6277. Published free-run errors of the position:
SUBNET 4.61 mm, dynoNet 2.64 mm.
"""

CASCADED_TANKS = """\
Two tanks one above the other; the pump fills the upper one, the sensor (uncalibrated, capacitive)
reads the lower one. The output is clipped at exactly 10 V. The document says that both records
start from the same unknown state, yet their first outputs are 5.205 V and 4.973 V. The document
scores all 1024 test samples, the official loader leaves out the first 50. Published free-run
errors, V: best linear 0.75, PNLSS 0.45, SUBNET 0.37, NLSS2 0.34, continuous-time SUBNET 0.306, grey
box with overflow 0.18 to 0.19.
"""

WIENER_HAMMERSTEIN = """\
Electronic circuit: Chebyshev low-pass, one-sided diode saturation, inverse Chebyshev low-pass.
Published free-run errors on the test part, mV: SUBNET 0.241, best dedicated Wiener-Hammerstein
method 0.28, PNLSS 0.42, dynoNet 0.452.
"""

BOUC_WEN = """\
Simulation of an oscillator with Bouc-Wen hysteresis. The output is in metres (plots of the document
are in millimetres). The training part carries the official noise, 8e-6 m RMS; the tests are without
noise: one steady period of a multisine, and a sweep from 20 to 50 Hz at 40 N from rest. Published
free-run errors on the multisine test, m: NFIR 16.3e-5, dynoNet 4.52e-5, PNLSS for hysteresis
1.87e-5; the output's standard deviation is 66.7e-5 m.
"""

F16 = """\
Full-size aircraft on the ground, shaken under the right wing. The force is measured at the
impedance head, the voltage is the generator's reference; accelerations at the shaker, on the wing
beside the payload interface, and on the payload beside it (unit not stated by the source). RMS
force of the multisine levels 1 to 7: 12.4 (behaves linearly), 24.6, 36.8, 61.4, 73.6, 85.7, 97.8 N;
of the sweep levels 1 to 3: 4.8 (linear), 19.2, 28.8 N.
"""

MR_DAMPER = """\
Prototype damper under random displacement (0 to 50 Hz) and random voltage; anti-alias filters at
100 Hz. The force is clipped at 4545.4545 N (217 samples of ransim). What ransim means is not
documented; it carries sensor noise and clipping like a measurement.
"""

BH_LOOPS = """\
Measured quasi-static B(H) loops of one material, points in the order of the run. The source fits
Jiles-Atherton models to them.
"""

DC_MOTOR_GENERATOR = """\
A DC motor turns a DC generator on the same shaft: armature, inertia, friction. The output is the
generator's signal, proportional to speed, from about 0 to 5850 in an unstated unit.
"""

BUCK_CONVERTER = """\
Buck converter driven by steps of its control voltage. Static gain y = (4 - u) Vd / 3 with Vd = 24
V. The output is quantised to 0.2 V and holds single-sample spikes.
"""

BUILDING_HEATING = """\
Hourly record of a heated building over 33 days of winter, under its thermostat. The source says
what is missing: solar gains, internal gains, hot water and canteen gas, and a holiday with the
heating off.
"""
