"""``python -m narx_sklearn`` is the ``narx-sklearn`` command."""

import sys

from narx_sklearn.cli import main

if __name__ == "__main__":
    sys.exit(main())
