"""Run the study from the command line."""

from scenarios.paper import main

if __name__ == "__main__":
    main()
