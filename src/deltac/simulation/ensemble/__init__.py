"""Many runs of one mechanism, side by side."""
