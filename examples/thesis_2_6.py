"""Example 2.6: the terms of model (2.30) grouped in clusters, and the clusters' coefficients (2.29)."""

from pathlib import Path

from _thesis import new_figure, out_folder, save
from thesis_2_5 import MODEL

from narx_sklearn.analysis import term_clusters


def main(folder: Path) -> None:
    """Print the clustering representation and draw the coefficients."""
    clusters = term_clusters(MODEL)
    print(clusters)
    table = clusters.to_frame()
    figure, ax = new_figure()
    ax.barh(table["cluster"], table["coefficient"])
    ax.axvline(0, color="black", linewidth=0.8)
    ax.invert_yaxis()
    ax.set(xlabel="cluster coefficient [-]", ylabel="term cluster")
    save(figure, folder, __file__)


if __name__ == "__main__":
    main(out_folder(__doc__))
