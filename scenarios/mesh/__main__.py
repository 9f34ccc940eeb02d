"""Run the study from the command line."""

from scenarios.mesh import main

if __name__ == "__main__":
    main()
