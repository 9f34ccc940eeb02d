"""Run the study from the command line."""

from scenarios.capacity_drop import main

if __name__ == "__main__":
    main()
