"""Serialised messages (CDR): what a type is made of, where a field lies, numbers out of many."""
