"""Files that are no bags: tables of numbers that are read, and tables that are written."""
