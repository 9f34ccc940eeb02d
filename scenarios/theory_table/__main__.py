"""Run the study from the command line."""

from scenarios.theory_table import main

if __name__ == "__main__":
    main()
