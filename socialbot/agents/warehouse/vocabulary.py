"""Words for the deeds of the gripper and the carriers, in English, German, French and Spanish."""

from socialbot.core.vocabulary import Deed, Vocabulary

VOCABULARY = Vocabulary(
    deeds=(
        Deed(
            calls=("gripper_move", "carrier_move"),
            words={
                "en": ("move", "go", "drive", "travel", "leave", "return", "come", "head"),
                "de": (
                    "fahren",
                    "gefahren",
                    "fuhr",
                    "fuhrst",
                    "bewegen",
                    "bewegt",
                    "gehen",
                    "gegangen",
                    "weggefahren",
                    "losgefahren",
                ),
                "fr": ("aller", "allé", "rouler", "roulé", "déplacer", "déplacé", "partir", "parti"),
                "es": ("ir", "fue", "fuiste", "mover", "movió", "moviste", "conducir", "salir", "salió"),
            },
        ),
        Deed(
            calls=("gripper_pickup",),
            words={
                "en": ("pick up", "pick", "lift", "take", "grab", "fetch", "get hold of", "seize", "grasp", "move"),
                "de": ("aufheben", "aufgehoben", "nehmen", "genommen", "greifen", "gegriffen"),
                "fr": ("prendre", "pris", "soulever", "soulevé", "ramasser"),
                "es": ("recoger", "recogió", "recogiste", "levantar", "levantó", "tomar", "tomó"),
            },
        ),
        Deed(
            calls=("gripper_put_on_carrier",),
            words={
                "en": ("put on", "put", "place", "load", "set", "move"),
                "de": ("legen", "gelegt", "stellen", "gestellt", "laden", "geladen"),
                "fr": ("poser", "posé", "mettre", "mis", "charger", "chargé"),
                "es": ("poner", "puso", "pusiste", "colocar", "colocó", "cargar", "cargó"),
            },
        ),
        Deed(
            calls=("gripper_putdown",),
            words={
                "en": ("put down", "set down", "lay down"),
                "de": ("ablegen", "abgelegt", "absetzen", "abgesetzt"),
                "fr": ("déposer", "déposé", "reposer"),
                "es": ("bajar", "bajó", "dejar", "dejó", "depositar"),
            },
        ),
        Deed(
            calls=("carrier_unload",),
            words={
                "en": ("unload", "empty", "deliver"),
                "de": ("entladen", "ausladen", "ausgeladen", "abladen"),
                "fr": ("décharger", "déchargé", "livrer"),
                "es": ("descargar", "descargó", "descargaste", "entregar"),
            },
        ),
        Deed(
            calls=("req_carrier_to_come",),
            words={
                "en": ("call", "summon", "order", "request", "have come"),
                "de": ("rufen", "gerufen", "bestellen", "bestellt"),
                "fr": ("appeler", "appelé", "demander"),
                "es": ("llamar", "llamó", "llamaste", "pedir"),
            },
        ),
        Deed(
            calls=("sort_boxes",),
            words={
                "en": ("sort boxes", "sort"),
                "de": ("sortieren", "sortiert"),
                "fr": ("trier", "trié"),
                "es": ("ordenar", "clasificar", "clasificó"),
            },
        ),
    ),
    names={
        "box": {
            "en": ("crate", "parcel", "package"),
            "de": ("Kiste", "Schachtel", "Karton", "Paket"),
            "fr": ("boîte", "caisse", "carton"),
            "es": ("caja", "paquete"),
        },
        "carrier": {
            "en": ("cart", "transporter"),
            "de": ("Träger", "Transporter", "Wagen"),
            "fr": ("transporteur", "chariot"),
            "es": ("transportador", "carro"),
        },
        "gripper": {
            "de": ("Greifer", "Greifarm"),
            "fr": ("pince", "préhenseur"),
            "es": ("pinza", "agarrador"),
        },
        "deposit": {"en": ("depot",), "de": ("Lager", "Depot"), "fr": ("dépôt",), "es": ("depósito",)},
        "base": {"de": ("Basis",)},
    },
)
