"""Run the study from the command line."""

from scenarios.burst_loss import main

if __name__ == "__main__":
    main()
