"""What stands behind the verbs: options, output, processes, the view. It knows no verb."""
