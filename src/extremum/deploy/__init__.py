"""The controller carried to real hardware: discrete time, C, and a clock."""
