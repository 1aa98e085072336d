"""Example 2.5: a NARX model is a sum of terms (2.30); what each of them contributes to a run."""

from pathlib import Path

import numpy as np
from _thesis import new_figure, out_folder, save

from narx_sklearn.model import Difference, NARXModel, free_run, predict_one_step

EQUATION = (
    "0.5*y[k-1] + 0.2*u[k-2] + 0.1*phi1[k-1] + 0.05*y[k-2]*u[k-4] - 0.1*y[k-1]*y[k-2] + 0.02*y[k-1]*u[k-1]"
    " + 0.3*u[k-1]*phi1[k-2]"
)
MODEL = NARXModel.from_equations(EQUATION, phi=[Difference("u", name="phi1")])


def main(folder: Path) -> None:
    """Split the free run into its terms; the terms add up to the output."""
    u = np.sin(2 * np.pi * np.arange(200) / 80)
    y = free_run(MODEL, u[:, None], np.zeros(MODEL.max_lag)).y
    print(MODEL)
    print(f"longest lag {MODEL.max_lag}, degree {MODEL.degree}")
    figure, ax = new_figure()
    total = np.zeros(u.size)
    for term, theta in MODEL.equation().items:
        alone = NARXModel.from_equations({term: theta}, phi=MODEL.phi)
        part = np.nan_to_num(predict_one_step(alone, u[:, None], y)[:, 0])
        total[MODEL.max_lag :] += part[MODEL.max_lag :]
        ax.plot(part, linewidth=1, label=f"{theta:g} {term}")
    ax.plot(y, color="black", label="y")
    print(f"sum of the terms minus y: {np.abs(total - y[:, 0])[MODEL.max_lag :].max():.1e}")
    ax.set(xlabel="sample k", ylabel="contribution to y [-]")
    ax.legend(frameon=False, fontsize="small", loc="upper left", bbox_to_anchor=(1, 1))
    save(figure, folder, __file__)


if __name__ == "__main__":
    main(out_folder(__doc__))
