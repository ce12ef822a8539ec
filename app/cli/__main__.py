"""``python -m app.cli``: the command ``ondelette`` by the interpreter at hand."""

from app.cli import main

if __name__ == "__main__":
    main(prog_name="ondelette")
