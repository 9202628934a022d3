"""Words for the deeds and rooms of the cleaners, in English, German, French and Spanish."""

from socialbot.core.vocabulary import Deed, Vocabulary

VOCABULARY = Vocabulary(
    deeds=(
        Deed(
            calls=("doclean",),
            words={
                "en": ("clean", "tidy"),
                "de": ("putzen", "geputzt", "reinigen", "gereinigt", "säubern", "gesäubert", "sauber machen"),
                "fr": ("nettoyer", "nettoyé", "laver", "lavé"),
                "es": ("limpiar", "limpiaste", "limpió", "limpiado", "fregar"),
            },
        ),
        Deed(
            calls=("movetoward",),
            words={
                "en": ("go", "move", "drive", "travel", "return", "leave", "enter"),
                "de": ("fahren", "gefahren", "fuhrst", "gehen", "gegangen", "gingst", "bewegen", "bewegt", "verlassen"),
                "fr": ("aller", "allé", "rouler", "roulé", "retourner", "retourné", "quitter", "quitté"),
                "es": ("ir", "fuiste", "fue", "ido", "mover", "moviste", "volver", "volviste", "dejar", "dejaste"),
            },
        ),
        Deed(
            calls=("recharge",),
            words={
                "en": ("recharge", "charge", "fill battery"),
                "de": ("laden", "geladen", "aufladen", "aufgeladen"),
                "fr": ("recharger", "rechargé", "charger", "chargé"),
                "es": ("recargar", "recargaste", "cargar", "cargaste"),
            },
        ),
        Deed(
            calls=("dosweep",),
            words={
                "en": ("sweep",),
                "de": ("fegen", "gefegt", "kehren", "gekehrt"),
                "fr": ("balayer", "balayé"),
                "es": ("barrer", "barriste", "barrió"),
            },
        ),
    ),
    names={
        "kitchen": {"de": ("Küche",), "fr": ("cuisine",), "es": ("cocina",)},
        "bathroom": {"en": ("bath",), "de": ("Bad", "Badezimmer"), "fr": ("salle de bain",), "es": ("baño",)},
        "bedroom": {"de": ("Schlafzimmer",), "fr": ("chambre",), "es": ("dormitorio", "habitación")},
        "dock": {
            "en": ("charging station",),
            "de": ("Ladestation",),
            "fr": ("station de charge",),
            "es": ("estación de carga",),
        },
    },
)
