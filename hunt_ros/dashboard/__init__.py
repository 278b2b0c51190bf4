"""
The operator's page: what is shown (`model`), how it gets to the browsers (`server`), who may.

No ROS in here: the node `dashboard` feeds the model and calls the services.
"""
