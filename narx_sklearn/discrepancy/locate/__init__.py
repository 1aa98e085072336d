"""Where a simulation and a recording part: which port, which times, which regions, which frequencies.

``ports`` compares the unknown signals that ``latent_force`` estimates on the ``tangent`` of a run, by their
``_likelihood`` over the ``_covered`` samples (kernels in ``_kalman``; ``_search`` finds the likeliest), and
``beside_fit`` what follows no signal with noise; ``concentrated`` takes off what parameters may make of one,
``force_curve`` and ``invariances`` (over ``_hats``) say what it is like. Of an effect that is known, ``felt``
says in which equation or output. ``segments`` and ``events`` tell when, ``regions`` over ``features`` where
in the machine's operation, ``bands`` at which frequencies.
"""

from narx_sklearn.discrepancy.locate._covered import Entry
from narx_sklearn.discrepancy.locate.bands import bands
from narx_sklearn.discrepancy.locate.beside_fit import BesideFit, Course, Refined
from narx_sklearn.discrepancy.locate.concentrated import concentrated_force
from narx_sklearn.discrepancy.locate.events import event_table, input_events
from narx_sklearn.discrepancy.locate.features import features
from narx_sklearn.discrepancy.locate.felt import felt_at
from narx_sklearn.discrepancy.locate.force_curve import force_curve
from narx_sklearn.discrepancy.locate.invariances import invariances
from narx_sklearn.discrepancy.locate.latent_force import Background, LatentForce, background, latent_force
from narx_sklearn.discrepancy.locate.ports import latent_forces, port_table, ports_of
from narx_sklearn.discrepancy.locate.regions import Condition, inside, regions, stated_regions
from narx_sklearn.discrepancy.locate.segments import segments
from narx_sklearn.discrepancy.locate.tangent import Tangent, tangent

__all__ = [
    "Background",
    "BesideFit",
    "Condition",
    "Course",
    "Entry",
    "LatentForce",
    "Refined",
    "Tangent",
    "background",
    "bands",
    "concentrated_force",
    "event_table",
    "features",
    "felt_at",
    "force_curve",
    "input_events",
    "inside",
    "invariances",
    "latent_force",
    "latent_forces",
    "port_table",
    "ports_of",
    "regions",
    "segments",
    "stated_regions",
    "tangent",
]
