"""Which few physical causes explain what a log leaves of its model's equations of motion."""
