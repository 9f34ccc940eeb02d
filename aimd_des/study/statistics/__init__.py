"""Statistics of replications and of long runs: intervals, stopping, batch means, steady state."""
