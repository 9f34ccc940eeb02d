"""Run the study from the command line."""

from scenarios.congested_channel import main

if __name__ == "__main__":
    main()
