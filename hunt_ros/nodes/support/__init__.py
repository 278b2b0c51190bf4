"""What the nodes share: messages, parameters, quality of service, threads, start and end."""
