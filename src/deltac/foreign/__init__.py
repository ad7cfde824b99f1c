"""What guards against foreign input: limits, regular files, scripts of users, processes that may crash."""
