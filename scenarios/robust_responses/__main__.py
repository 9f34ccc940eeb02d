"""Run the study from the command line."""

from scenarios.robust_responses import main

if __name__ == "__main__":
    main()
