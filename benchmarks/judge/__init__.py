"""The judge's bench: logs with known truth, what `audit` says of them, and what an oracle could."""
