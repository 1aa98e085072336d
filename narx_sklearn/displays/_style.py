"""What the figures share: matplotlib when it is there, and a few colours."""

# Okabe and Ito's palette: told apart with any colour vision, and in grey by their lightness
BLUE = "#0072B2"
VERMILION = "#D55E00"
GREY = "#8C8C8C"


def import_pyplot():
    """Return ``matplotlib.pyplot``.

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message says how to get it.
    """
    try:
        import matplotlib.pyplot as plt
    except ImportError as error:
        raise ImportError('Figures need matplotlib: pip install "narx-sklearn[plot]"') from error
    return plt
