"""Pictures and pages of results, and files that appear complete or not at all."""
