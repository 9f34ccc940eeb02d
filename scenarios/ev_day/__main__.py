"""Run the study from the command line."""

from scenarios.ev_day import main

if __name__ == "__main__":
    main()
