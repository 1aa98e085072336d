"""Figures of a score, and one of every case's recording."""

from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.concealed.bounds import calibration_bins
from benchmarks.concealed.sealing import read_json

__all__ = ["draw_cases", "draw_score"]


def _pyplot():
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    return plt


def draw_score(tables: dict[str, pd.DataFrame], folder: Path) -> None:
    """Draw names by depth, the confusion matrix and the calibration curve."""
    plt = _pyplot()
    cases = tables["cases"]
    if "first_right" in cases:
        known = cases.dropna(subset=["first_right"])
        fig, ax = plt.subplots(figsize=(5, 3.2), layout="constrained")
        edges = np.geomspace(0.03, 3.0, 9)
        groups = known.groupby(pd.cut(known["R"], edges), observed=True)
        depth = groups["R"].mean()
        ax.plot(depth, groups["first_right"].mean(), "o-", label="named first")
        ax.plot(depth, groups["wrong_name"].mean(), "s-", label="wrongly named")
        sees = known.assign(sees=known["oracle_z"] > 3.0).groupby(pd.cut(known["R"], edges), observed=True)
        ax.plot(depth, sees["sees"].mean(), "k--", label="oracle sees it")
        ax.set(
            xscale="log", xlabel="structural residual / noise", ylabel="share of cases", ylim=(-0.02, 1.02)
        )
        ax.legend()
        fig.savefig(folder / "depth.png", dpi=120)
        plt.close(fig)
    confusion = tables["confusion"]
    if not confusion.empty:
        size = 2.0 + 0.22 * np.array(confusion.shape[::-1])
        fig, ax = plt.subplots(figsize=tuple(size), layout="constrained")
        ax.imshow(confusion.div(confusion.sum(axis=1), axis=0), cmap="Blues", vmin=0.0, vmax=1.0)
        ax.set_xticks(range(confusion.shape[1]), confusion.columns, rotation=90, fontsize=7)
        ax.set_yticks(range(confusion.shape[0]), confusion.index, fontsize=7)
        ax.set(xlabel="said first", ylabel="concealed")
        fig.savefig(folder / "confusion.png", dpi=120)
        plt.close(fig)
    sure = cases.dropna(subset=[c for c in ("confidence", "first_right") if c in cases])
    if "first_right" in cases and len(sure):
        bins = calibration_bins(sure["confidence"], sure["first_right"])
        fig, ax = plt.subplots(figsize=(3.4, 3.4), layout="constrained")
        ax.plot([0, 1], [0, 1], "k:", lw=1)
        ax.scatter(bins[:, 0], bins[:, 1], s=10 + 4 * np.sqrt(bins[:, 2]))
        ax.set(xlabel="confidence", ylabel="share right", xlim=(0, 1), ylim=(0, 1))
        fig.savefig(folder / "calibration.png", dpi=120)
        plt.close(fig)


def draw_cases(out: Path, folder: Path, per_page: int = 24) -> list[Path]:
    """Draw every case: first output, and what the effect makes in it beside the noise (truths are opened)."""
    plt = _pyplot()
    out, folder = Path(out), Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    names = sorted(read_json(out / "manifest.json")["cases"])
    pages = []
    for first in range(0, len(names), per_page):
        fig, axes = plt.subplots(per_page // 4, 4, figsize=(18, 2.6 * per_page // 4), layout="constrained")
        for ax, name in zip(axes.flat, names[first : first + per_page], strict=False):
            truth = read_json(out / "truth" / f"{name}.json")
            recording = pd.read_csv(out / "cases" / name / "recording.csv")
            t, last = recording["time [s]"], recording.columns[-1]
            ax.plot(t, recording[recording.columns[2]], lw=0.4, color="0.7")
            twin = ax.twinx()
            twin.plot(t, recording[last], lw=0.6, color="C0")
            what = "+".join(f"{e['effect']}@{e['port']}" for e in truth["effects"]) or "nothing"
            ax.set_title(
                f"{truth['plant']}: {what}\nR={truth['R']:.2f} {truth['noise']} {truth['excitation']}",
                fontsize=8,
            )
            twin.set_ylabel(last, fontsize=7)
            ax.tick_params(labelsize=6)
            twin.tick_params(labelsize=6)
        pages.append(folder / f"cases-{first // per_page}.png")
        fig.savefig(pages[-1], dpi=70)
        plt.close(fig)
    return pages
