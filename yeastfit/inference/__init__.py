"""From numbers to parameters: targets, fits, designs and posteriors."""
