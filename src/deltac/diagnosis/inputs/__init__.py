"""What users hand over (models, logs, equations), resolved and checked at the door."""
