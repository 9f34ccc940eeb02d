"""Run the study from the command line."""

from scenarios.usable import main

if __name__ == "__main__":
    main()
