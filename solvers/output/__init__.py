"""What is made of an answer: tables, pictures, files, commands, a bundle."""
