"""A reader that knows the sensor, not the shapes: log p(image | contact) / p(image) = f(image) · h(contact)."""
