"""Run the study from the command line."""

from scenarios.churn import main

if __name__ == "__main__":
    main()
