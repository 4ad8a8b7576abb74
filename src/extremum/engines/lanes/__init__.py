"""What the ensemble engines share: a loop as a straight-line program."""
