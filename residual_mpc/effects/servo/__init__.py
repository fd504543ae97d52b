"""What effects mean for a servo: equivalents in its motor's constants, its numbers in a table, what can be changed."""
