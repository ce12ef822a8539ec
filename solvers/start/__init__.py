"""Where a solve begins: guesses, scales, first answers, several starts."""
