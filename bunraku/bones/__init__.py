"""From curves and motion to a rigged performer: bones, skin, clip (Transfer4D, Sec. 4.3-4.4)."""
