"""Forward models as commands see them: settings, parameters, data, simulators, pictures."""
