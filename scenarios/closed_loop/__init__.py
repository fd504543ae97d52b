"""What the closed-loop experiments share: robot set-up, training runs, controllers, results."""
