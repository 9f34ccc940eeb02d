"""What everything else stands on, and what knows nothing of AIMD: errors, checks, compiling, numbers."""
