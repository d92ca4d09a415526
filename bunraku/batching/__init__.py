"""Many figures overnight: a process a job, results named by content, nothing done twice."""
