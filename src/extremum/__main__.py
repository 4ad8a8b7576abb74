"""`python -m extremum`."""

import sys

from .cli import main

sys.exit(main())
