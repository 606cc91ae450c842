"""What the proprioceptive triggers are worth: whole episodes with them, and with polling instead."""
