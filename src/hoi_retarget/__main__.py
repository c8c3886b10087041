"""`python -m hoi_retarget` is the command line."""

import sys

from hoi_retarget.cli import main

sys.exit(main())
