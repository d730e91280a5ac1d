"""`python -m diffshade`."""

import sys

from diffshade.cli import main

sys.exit(main())
