"""Logs as other people make them: simulators, habits and imperfections that `audit` must cope with."""
