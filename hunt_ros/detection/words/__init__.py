"""What is told of the rows: events, reasons, the status, and the history of the alarms."""
