"""Run the study from the command line."""

from scenarios.unusual_activity import main

if __name__ == "__main__":
    main()
