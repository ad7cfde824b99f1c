"""Fleets: thousands of runs, studies and audits, on all cores or a cluster, that survive anything."""
