"""Many results on one page, with verdicts on their fitness for use and reasons."""
