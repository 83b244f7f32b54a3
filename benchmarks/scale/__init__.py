"""How time, memory and error grow with the number of views: a street of known albedo, as long as asked."""
